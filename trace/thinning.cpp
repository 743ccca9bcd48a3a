#include "trace/thinning.hpp"

#include <algorithm>
#include <cmath>

namespace twinrate {
namespace {

constexpr double kEnough_Hz = 5000;
constexpr std::size_t kSeam = 3;  // unusable thinned rows at a seam

// Weights of the rows 0, 1 .. on either side.
std::vector<double> weights(std::size_t rows) {
  std::vector<double> w;
  for (std::size_t j = 0; j < 2 * rows; ++j) {
    const double m = static_cast<double>(rows), x = static_cast<double>(j) / m;
    w.push_back((2 - x) * (1 - x) * (x < 1 ? (1 + x) / 2 : (3 - x) / 6) / m);
  }
  return w;
}

// Reach of a thinned row to either side.
std::size_t reach(std::size_t rows) {
  return 2 * rows - 1;
}

// Rows of the record at the centres of the thinned ones; a voltage reaches rows - 1 further. No
// thinned row contains a step of time.
std::vector<std::size_t> centres(const Record& record, std::size_t rows) {
  constexpr double kApart = 12;  // rows; appended records are twice this far apart
  const std::size_t back = reach(rows), on = back + rows - 1;
  const double longest = (static_cast<double>(back + on) + kApart) * record.T_s;
  std::vector<std::size_t> at;
  for (std::size_t k = back; k + on < record.size(); k += rows)
    if (record.t[k + on] - record.t[k - back] < longest) at.push_back(k);
  return at;
}

template <class Value>
std::vector<Value> taken(const std::vector<Value>& x, const std::vector<std::size_t>& at) {
  std::vector<Value> out;
  if (x.empty()) return out;
  out.reserve(at.size());
  for (std::size_t k : at) out.push_back(x[k]);
  return out;
}

}  // namespace

std::size_t rows_as_one(double T_s) {
  constexpr double kRounding = 1e-3;
  return static_cast<std::size_t>(std::max(1.0, std::floor(1 / (T_s * kEnough_Hz) + kRounding)));
}

Record thinned(const Record& record, std::size_t rows, int n_p) {
  if (rows <= 1) return record;
  const std::vector<double> weight = weights(rows);
  const std::vector<std::size_t> at = centres(record, rows);
  // `value` of the thinned row and a row of the record.
  const auto weighted = [&](const auto& x, auto&& value) {
    std::decay_t<decltype(x)> out;
    if (x.empty()) return out;
    out.reserve(at.size());
    for (std::size_t K = 0; K < at.size(); ++K) {
      const std::size_t k = at[K];
      auto sum = decltype(value(K, k))(weight[0] * value(K, k));
      for (std::size_t j = 1; j <= reach(rows); ++j)
        if (weight[j] != 0) sum += weight[j] * (value(K, k - j) + value(K, k + j));
      out.push_back(sum);
    }
    return out;
  };
  const auto plain = [&](const std::vector<double>& x) {
    return weighted(x, [&](std::size_t, std::size_t row) { return x[row]; });
  };
  const std::vector<double> theta_m = plain(record.theta_m);
  // Voltages and currents as columns, rotated by the angle of the rotor from the row to the thinned
  // one.
  const auto turned = [&](const std::vector<Eigen::Matrix2d>& x) {
    return weighted(x, [&](std::size_t K, std::size_t row) -> Eigen::Matrix2d {
      const auto [s, c] = math::sincos(n_p * (theta_m[K] - record.theta_m[row]));
      Eigen::Matrix2d there;
      there.row(0) = c * x[row].row(0) - s * x[row].row(1);
      there.row(1) = s * x[row].row(0) + c * x[row].row(1);
      return there;
    });
  };
  Record out;
  out.source = record.source;
  out.begin_s = record.begin_s;
  out.T_s = static_cast<double>(rows) * record.T_s;
  out.rows_each = record.rows_each * static_cast<int>(rows);
  out.current_sensors = record.current_sensors;
  out.load_measured = record.load_measured;
  out.i_q_alone = record.i_q_alone;
  out.angle = record.angle;
  out.t = taken(record.t, at);
  const bool u = !record.u_alphabeta.empty(), i = !record.i_alphabeta.empty();
  std::vector<Eigen::Matrix2d> u_and_i(u || i ? record.size() : 0, Eigen::Matrix2d::Zero());
  for (std::size_t k = 0; k < u_and_i.size(); ++k) {
    if (i) u_and_i[k].col(1) = record.i_alphabeta[k];
    if (!u) continue;
    u_and_i[k].col(0) = record.u_alphabeta[k];
    if (k + rows > record.size()) continue;
    for (std::size_t l = 1; l < rows; ++l) u_and_i[k].col(0) += record.u_alphabeta[k + l];
    u_and_i[k].col(0) /= static_cast<double>(rows);
  }
  for (const Eigen::Matrix2d& columns : turned(u_and_i)) {
    if (u) out.u_alphabeta.emplace_back(columns.col(0));
    if (i) out.i_alphabeta.emplace_back(columns.col(1));
  }
  out.theta_m = theta_m;
  out.v_dc = plain(record.v_dc);
  out.T_load = plain(record.T_load);
  const auto usable = [&](const std::vector<char>& ok, std::size_t on) {
    std::vector<char> all;
    for (std::size_t k : at) {
      char good = 1;
      for (std::size_t row = k - reach(rows); row <= k + on; ++row) good = good && ok[row];
      all.push_back(good);
    }
    // Differences across a seam would mix both sides.
    for (std::size_t K = 1; K < at.size(); ++K)
      if (at[K] - at[K - 1] > rows)
        std::fill_n(all.begin() + static_cast<std::ptrdiff_t>(K - std::min(K, kSeam)),
                    std::min(K, kSeam) + std::min(kSeam, at.size() - K), 0);
    return all;
  };
  out.electrical_ok = usable(record.electrical_ok, reach(rows) + rows - 1);
  out.motion_ok = usable(record.motion_ok, reach(rows));
  return out;
}

std::vector<char> thinned(const std::vector<char>& of_rows, const Record& record,
                          std::size_t rows) {
  return rows <= 1 ? of_rows : taken(of_rows, centres(record, rows));
}

std::vector<int> thinned(const std::vector<int>& of_rows, const Record& record, std::size_t rows) {
  return rows <= 1 ? of_rows : taken(of_rows, centres(record, rows));
}

}  // namespace twinrate
