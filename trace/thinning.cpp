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

// True if the rows from `first` to `last` follow each other in time.
bool in_one(const Record& record, std::size_t first, std::size_t last) {
  constexpr double kApart = 12;  // rows; appended records are twice this far apart
  return record.t[last] - record.t[first] <
         (static_cast<double>(last - first) + kApart) * record.T_s;
}

// Rows of the record at the centres of the thinned ones; a voltage reaches rows - 1 further. No
// thinned row contains a step of time.
std::vector<std::size_t> centres(const Record& record, std::size_t rows) {
  const std::size_t back = reach(rows), on = back + rows - 1;
  std::vector<std::size_t> at;
  for (std::size_t k = back; k + on < record.size(); k += rows)
    if (in_one(record, k - back, k + on)) at.push_back(k);
  return at;
}

// rad a row, mean over the rows around k. It has to be smooth: the controller's voltage responds to
// the error of each reading, so a rotation by single readings would leave the mean of a product.
double speed_around(const Record& record, std::size_t k, std::size_t rows) {
  constexpr std::size_t kThinned = 8;  // thinned rows on each side
  std::size_t h = kThinned * rows;
  if (k < h || k + h >= record.size() || !in_one(record, k - h, k + h)) h = reach(rows);
  double turned = 0;
  for (std::size_t j = 1; j <= h; ++j) turned += record.theta_m[k + j] - record.theta_m[k - j];
  return turned / static_cast<double>(h * (h + 1));
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
  const auto plain = [&](const std::vector<double>& x) {
    std::vector<double> out;
    if (x.empty()) return out;
    out.reserve(at.size());
    for (std::size_t k : at) {
      double sum = weight[0] * x[k];
      for (std::size_t j = 1; j <= reach(rows); ++j)
        if (weight[j] != 0) sum += weight[j] * (x[k - j] + x[k + j]);
      out.push_back(sum);
    }
    return out;
  };
  // Voltages and currents as columns, in axes that turn with the mean speed around k.
  const auto turned = [&](const std::vector<Eigen::Matrix2d>& x) {
    std::vector<Eigen::Matrix2d> out;
    if (x.empty()) return out;
    out.reserve(at.size());
    for (std::size_t k : at) {
      const double turn = n_p * speed_around(record, k, rows);
      Eigen::Matrix2d sum = weight[0] * x[k];
      for (std::size_t j = 1; j <= reach(rows); ++j) {
        if (weight[j] == 0) continue;
        const auto [s, c] = math::sincos(turn * static_cast<double>(j));
        const Eigen::Matrix2d both = x[k - j] + x[k + j], ahead = x[k - j] - x[k + j];
        sum.row(0) += weight[j] * (c * both.row(0) - s * ahead.row(1));
        sum.row(1) += weight[j] * (s * ahead.row(0) + c * both.row(1));
      }
      out.push_back(sum);
    }
    return out;
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
  out.theta_m = plain(record.theta_m);
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
