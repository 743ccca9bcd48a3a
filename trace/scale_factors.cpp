#include "trace/scale_factors.hpp"

#include <algorithm>
#include <array>
#include <numeric>
#include <vector>

#include "model/linear_algebra.hpp"

namespace twinrate {
namespace {

constexpr double kCell_s = 4e-3;  // of a voltage cell; at least one interval
constexpr std::size_t kMostCells = 800;
constexpr std::size_t kBlocks = 20;   // for the standard deviations
constexpr double kSameColumn = 1e-6;  // of the power: columns with a smaller difference are equal
// Spread of the speed over its rms. In a loop that holds the speed, only disturbances move the
// rotor. The current responds to them, and the ratio of the two is no inertia. One drawn log (an
// eccentric load, 11 times K_t/J) is the reason.
constexpr double kHeld = 0.1;
// Share by which R_s may change with and without a dead time, and R_s and L with and without a
// winding that warms.
constexpr double kSame = 0.3;
constexpr double kNegligible = 0.05;  // a term below this share (amplitude) has no scale

double sign(double x) {
  return static_cast<double>((x > 0) - (x < 0));
}

double sinc(double x) {
  return std::abs(x) < 1e-4 ? 1 : std::sin(x) / x;
}

// Least squares with standard deviations from blocks.
template <int N>
class BlockLeastSquares {
 public:
  using Row = Eigen::Matrix<double, N, 1>;
  using Matrix = Eigen::Matrix<double, N, N>;
  explicit BlockLeastSquares(std::size_t rows) : rows_(std::max<std::size_t>(1, rows)) {}
  void add(std::size_t at, const Row& x, double y) {
    Block& b = blocks_[std::min(kBlocks - 1, kBlocks * at / rows_)];
    b.A += x * x.transpose();
    b.b += x * y;
    power_ += y * y;
    ++count_;
  }
  void solve() {
    Matrix A = Matrix::Zero();
    Row b = Row::Zero();
    for (const Block& block : blocks_) A += block.A, b += block.b;
    scale_ = A.diagonal().cwiseSqrt();
    Row inverse = scale_;
    for (double& s : inverse) s = s > 0 ? 1 / s : 0;
    const Matrix D = inverse.asDiagonal();
    const auto [values, vectors] = linear::symmetric_eigen(D * A * D);
    Matrix inverted = Matrix::Zero();
    for (int j = 0; j < N; ++j) {
      const Row direction = vectors.col(j);
      if (values[j] > kSameColumn)
        inverted += direction * direction.transpose() / values[j];
      else
        hidden_ += direction.cwiseAbs2();
    }
    inverted = D * inverted * D;
    beta_ = inverted * b;
    Matrix spread = Matrix::Zero();
    for (const Block& block : blocks_) {
      const Row g = block.b - block.A * beta_;
      spread += g * g.transpose();
    }
    rest_ = std::max(0.0, power_ - b.dot(beta_));
    const double left = std::max(1.0, static_cast<double>(count_) - N);
    const Row plain = (rest_ / left * inverted).diagonal();
    const Row robust = (inverted * spread * inverted).diagonal();
    sigma_ = plain.cwiseMax(robust).cwiseMax(0).cwiseSqrt();
    alone_ = inverted.diagonal();
  }
  ScaleRatio ratio(int j) const {
    // The term as declared, and as fitted: one of them must be a relevant part of the sum.
    const double term = scale_[j] * std::max(1.0, std::abs(beta_[j]));
    if (hidden_[j] > kSameColumn || !(power_ > 0) || term < kNegligible * std::sqrt(power_))
      return {};
    return {beta_[j], sigma_[j], std::pow(beta_[j] - 1, 2) / std::max(alone_[j] * rest_, 1e-300)};
  }
  bool told(int j) const { return hidden_[j] <= kSameColumn && scale_[j] > 0; }
  double beta(int j) const { return beta_[j]; }
  double sigma(int j) const { return sigma_[j]; }
  // Power that column j explains beside the others, and the residual power.
  double gain(int j) const { return alone_[j] > 0 ? beta_[j] * beta_[j] / alone_[j] : 0; }
  double rest() const { return rest_; }
  double column_power(int j) const { return scale_[j] * scale_[j]; }
  double power() const { return power_; }
  std::size_t count() const { return count_; }
  CellPower cell_power() const {
    CellPower out{.A = Matrix::Zero(), .b = Row::Zero(), .power = power_, .rest = rest_};
    for (const Block& block : blocks_) out.A += block.A, out.b += block.b;
    out.cells = static_cast<double>(count_);
    return out;
  }

 private:
  struct Block {
    Matrix A = Matrix::Zero();
    Row b = Row::Zero();
  };
  std::size_t rows_, count_ = 0;
  std::array<Block, kBlocks> blocks_;
  Row hidden_ = Row::Zero();  // share of a column that the others repeat
  Row beta_ = Row::Zero(), sigma_ = Row::Zero(), scale_ = Row::Zero(), alone_ = Row::Zero();
  double power_ = 0, rest_ = 0;
};

// The log in a given reading: angle from row to row, currents and voltages in rotor axes.
class ReadLog {
 public:
  ReadLog(const Record& record, const DriveFacts& facts, const Reading& as)
      : record_(record), n_p_(facts.machine.n_p), as_(as), theta_m_(record.theta_m) {
    if (as.angle_factor == 1) return;
    for (std::size_t k = 0; k < theta_m_.size(); ++k) {
      const double step = k == 0 ? 0 : record.theta_m[k] - record.theta_m[k - 1];
      theta_m_[k] = k == 0 ? as.angle_factor * record.theta_m[0]
                           : theta_m_[k - 1] + wrap_pi(as.angle_factor * step);
    }
  }
  double theta_m(std::size_t k) const { return theta_m_[k]; }
  Vec2 i_dq(std::size_t k) const {
    Vec2 i = record_.i_alphabeta[k];
    if (as_.mirrored) i[1] = -i[1];
    return park(i, frame(k, as_.current_stands) - as_.current_turn);
  }
  // Mean over the interval from row k on, or the value at its beginning.
  Vec2 u_dq(std::size_t k) const {
    const double half_turn_e =
        as_.voltage_of_tick ? 0 : 0.5 * n_p_ * (theta_m_[k + 1] - theta_m_[k]);
    return park(record_.u_alphabeta[k], frame(k, as_.voltage_stands) + half_turn_e);
  }
  bool voltage_of_tick() const { return as_.voltage_of_tick; }
  // Count of the encoder in rad, electrical; 0: none that matters.
  double step_e() const { return std::abs(as_.angle_factor) * n_p_ * record_.angle.lsb; }
  bool neighbours(std::size_t k) const {
    return record_.t[k + 1] - record_.t[k] < 1.5 * record_.T_s;
  }

 private:
  double frame(std::size_t k, bool stands) const {
    return n_p_ * (stands ? record_.theta_m[k] : theta_m_[k]);
  }
  const Record& record_;
  int n_p_;
  Reading as_;
  std::vector<double> theta_m_;
};

// Clarke of the phases' signs, in rotor axes: the shape of a dead time.
Vec2 dead_time_shape(const Vec2& i_alphabeta_in_axes, double theta_e, double soft) {
  Vec3 i_abc = inverse_clarke(inverse_park(i_alphabeta_in_axes, theta_e));
  for (double& i : i_abc) i = i / (std::abs(i) + soft);
  return park(clarke(i_abc), theta_e);
}

void fit_voltage(const Record& record, const DriveFacts& facts, const ReadLog& log,
                 ScaleFactors& out) {
  const MachineParameters& m = facts.machine;
  const std::size_t n = record.size();
  const auto cell = static_cast<std::size_t>(std::max(1.0, std::floor(kCell_s / record.T_s)));
  const std::size_t stride = std::max(cell, n / kMostCells);
  const double soft = 0.02 * (m.i_rated > 0 ? m.i_rated : 1);
  BlockLeastSquares<5> fit(n);
  BlockLeastSquares<4> without_shape(n);
  BlockLeastSquares<6> with_turn(n), with_drift(n);
  double rows_power = 0, cells_power = 0, turned = 0;
  std::size_t rows = 0;
  for (std::size_t first = 0; first + cell < n; first += stride) {
    bool ok = true;
    Vec2 u = Vec2::Zero(), i = Vec2::Zero(), shape = Vec2::Zero();
    double power = 0;
    for (std::size_t k = first; k < first + cell && ok; ++k) {
      ok = record.electrical_ok[k] && record.electrical_ok[k + 1] && log.neighbours(k);
      if (!ok) break;
      const Vec2 mean = 0.5 * (log.i_dq(k) + log.i_dq(k + 1));
      u += log.u_dq(k);
      i += mean;
      shape += dead_time_shape(mean, 0.5 * m.n_p * (log.theta_m(k) + log.theta_m(k + 1)), soft);
      power += record.u_alphabeta[k].squaredNorm();
    }
    if (!ok) continue;
    const double N = static_cast<double>(cell), W = N * record.T_s;
    u /= N, i /= N, shape /= N;
    const double turn_e = m.n_p * (log.theta_m(first + cell) - log.theta_m(first));
    const double kept = log.voltage_of_tick() ? 1 : sinc(0.5 * turn_e / N);
    const double omega_e = turn_e / W;
    const Vec2 rate = (log.i_dq(first + cell) - log.i_dq(first)) / W;
    const Vec2 flux = kept * Vec2(m.L_d * rate[0] - omega_e * m.L_q * i[1],
                                  m.L_q * rate[1] + omega_e * m.L_d * i[0]);
    const double emf = kept * omega_e * m.psi_f;
    i *= kept, shape *= kept;
    fit.add(first, {m.R_s * i[0], flux[0], 0, -emf, shape[0]}, u[0]);
    fit.add(first, {m.R_s * i[1], flux[1], emf, 0, shape[1]}, u[1]);
    const double half_turn = 0.5 * turn_e / N;
    with_turn.add(first, {m.R_s * i[0], flux[0], 0, -emf, shape[0], -half_turn * u[1]}, u[0]);
    with_turn.add(first, {m.R_s * i[1], flux[1], emf, 0, shape[1], half_turn * u[0]}, u[1]);
    const Vec2 drift = m.R_s * (static_cast<double>(first) / static_cast<double>(n) - 0.5) * i;
    with_drift.add(first, {m.R_s * i[0], flux[0], 0, -emf, shape[0], drift[0]}, u[0]);
    with_drift.add(first, {m.R_s * i[1], flux[1], emf, 0, shape[1], drift[1]}, u[1]);
    without_shape.add(first, {m.R_s * i[0], flux[0], 0, -emf}, u[0]);
    without_shape.add(first, {m.R_s * i[1], flux[1], emf, 0}, u[1]);
    rows_power += power;
    cells_power += N * u.squaredNorm();
    turned += std::pow(turn_e / N, 2);
    ++rows;
  }
  if (rows < 50 || !(rows_power > 0)) return;
  fit.solve();
  out.mean_interval_e = std::sqrt(turned / static_cast<double>(rows));
  without_shape.solve();
  with_turn.solve();
  with_drift.solve();
  if (with_turn.told(5))
    out.turned = {.value = with_turn.beta(5), .sigma = with_turn.sigma(5), .over_rest = 0};
  // A voltage that is non-linear in the current can look like a resistance, or the reverse. The
  // added voltage of a winding that warms at constant speed can look like any of the terms.
  const auto same = [&](const auto& other, int j) {
    return std::abs(other.beta(j) - fit.beta(j)) < kSame * std::abs(fit.beta(j));
  };
  if (same(without_shape, 0) && same(with_drift, 0)) out.R_s = fit.ratio(0);
  if (same(with_drift, 1)) out.L = fit.ratio(1);
  // A frame off by half a count has that share of the EMF in the other axis. A cell with rounded
  // ends has another speed, and the currents' jumps at the counts correlate with it.
  const double cell_turn_e = out.mean_interval_e * static_cast<double>(cell);
  const double rounded = log.step_e() / std::sqrt(6) / std::max(cell_turn_e, 1e-9);
  const double leak = std::hypot(0.5 * log.step_e(), rounded);
  for (const auto& [ratio, j] : {std::pair{&out.R_s, 0}, std::pair{&out.L, 1}})
    ratio->sigma =
        std::hypot(ratio->sigma,
                   leak * std::sqrt(fit.column_power(2) / std::max(fit.column_power(j), 1e-300)));
  // Least squares attenuate psi_f by the rounding's share of the EMF's power, and leave the product
  // of both shares.
  const double share = std::min(rounded * rounded, 0.9);
  const ScaleRatio along_d = fit.ratio(2), along_q = fit.ratio(3);
  const double psi = std::hypot(along_d.value, along_q.value);
  if (psi > 0) {
    out.psi_f = {psi, std::hypot(fit.sigma(2), fit.sigma(3), psi * share / (1 - share)),
                 std::pow(psi - 1, 2) * fit.column_power(2) / std::max(fit.rest(), 1e-300)};
    out.zero_e = std::atan2(fit.beta(3), fit.beta(2));
  }
  out.voltage = fit.cell_power();
  out.emf_share = fit.column_power(2) / std::max(fit.power(), 1e-300);
  out.rounded_share = out.emf_share * share * (1 - share);
  out.cell_share = 1 - fit.rest() / std::max(fit.power(), 1e-300);
  out.voltage_share = cells_power * out.cell_share / rows_power;
}

// Rows of half a torque cell, so that its acceleration is well above the steps of the angle.
std::size_t torque_reach(const Record& record, const ReadLog& log) {
  constexpr double kAbove = 20, kLeast_s = 5e-3, kMost_s = 0.1;
  constexpr std::size_t kFewestCells = 400;  // except in a log that lasts that long
  const auto most = std::max({static_cast<std::size_t>(kMost_s / record.T_s),
                              record.size() / kFewestCells, std::size_t{2}});
  auto h = static_cast<std::size_t>(std::max(1.0, std::ceil(kLeast_s / record.T_s)));
  const auto rms = [&](std::size_t reach, int differences) {
    double sum = 0, count = 0;
    for (std::size_t k = 2 * reach; k + 2 * reach < record.size(); k += reach) {
      const double span = record.t[k + 2 * reach] - record.t[k - 2 * reach];
      if (span > (4 * static_cast<double>(reach) + 0.5) * record.T_s) continue;  // the next file
      const double second = log.theta_m(k + reach) - 2 * log.theta_m(k) + log.theta_m(k - reach);
      const double third = log.theta_m(k + 2 * reach) - 2 * log.theta_m(k + reach) +
                           2 * log.theta_m(k - reach) - log.theta_m(k - 2 * reach);
      sum += std::pow(differences == 2 ? second : third, 2);
      ++count;
    }
    return std::sqrt(sum / std::max(1.0, count));
  };
  const double row_noise = rms(1, 3);  // of the angle, plus the motion within rows
  while (h < most && rms(h, 2) < kAbove * row_noise) h *= 2;
  return h;
}

// Mean of -i_q omega_m over blocks of rows, over its standard deviation.
double braking(const Record& record, const ReadLog& log, const std::vector<double>& i_q) {
  const std::size_t rows = (record.size() - 1) / kBlocks;
  std::array<double, kBlocks> means{};
  for (std::size_t b = 0; b < kBlocks; ++b)
    for (std::size_t k = b * rows; k < (b + 1) * rows; ++k)
      if (record.motion_ok[k]) means[b] -= i_q[k] * (log.theta_m(k + 1) - log.theta_m(k));
  const double mean = std::accumulate(means.begin(), means.end(), 0.0) / kBlocks;
  double squares = 0;
  for (const double x : means) squares += (x - mean) * (x - mean);
  return mean / std::sqrt(std::max(squares / (kBlocks * (kBlocks - 1)), 1e-300));
}

void fit_torque(const Record& record, const DriveFacts& facts, const ReadLog& log,
                ScaleFactors& out) {
  const MachineParameters& m = facts.machine;
  const std::size_t n = record.size(), h = torque_reach(record, log);
  if (n < 8 * h) return;
  constexpr double kFits = 0.9, kTurn = 0.5;  // the angle's zero from the voltage is valid
  const bool zero_known = out.cell_share > kFits && out.mean_interval_e < kTurn;
  const double zero_e = zero_known ? out.zero_e : 0;
  std::vector<double> i_q(n);
  for (std::size_t k = 0; k < n; ++k) i_q[k] = park(log.i_dq(k), zero_e)[1];
  const bool load = !record.T_load.empty();
  BlockLeastSquares<5> fit(n);
  double speeds = 0, squares = 0;
  const double W = static_cast<double>(h) * record.T_s;
  for (std::size_t k = h; k + h < n; k += h) {
    double current = 0, T_load = 0;
    bool ok = true;
    for (std::size_t j = k - h; j <= k + h && ok; ++j) {
      ok = record.motion_ok[j] && (j == k + h || log.neighbours(j));
      const double w =
          (static_cast<double>(h) - std::abs(static_cast<double>(j) - static_cast<double>(k))) /
          static_cast<double>(h * h);
      current += w * i_q[j];
      if (load) T_load += w * record.T_load[j];
    }
    if (!ok) continue;
    const double before = log.theta_m(k) - log.theta_m(k - h),
                 behind = log.theta_m(k + h) - log.theta_m(k);
    const double omega_m = (before + behind) / (2 * W), rate = (behind - before) / (W * W);
    speeds += omega_m, squares += omega_m * omega_m;
    fit.add(k, {m.torque_constant() * current, -T_load, -sign(omega_m), -omega_m, -1},
            m.J * rate + m.B * omega_m);
  }
  const double count = static_cast<double>(fit.count());
  const bool held = squares / count - std::pow(speeds / count, 2) < kHeld * kHeld * squares / count;
  if (held) out.braking = braking(record, log, i_q);
  if (fit.count() < 50) return;
  fit.solve();
  out.torque = fit.cell_power();
  if (!held) out.K_t_J = fit.ratio(0);
  if (load) out.T_load = fit.ratio(1);
  out.torque_share = fit.gain(0) / std::max(fit.gain(0) + fit.rest(), 1e-300);
}

}  // namespace

ScaleFactors scale_factors(const Record& record, const DriveFacts& facts, const Reading& as) {
  ScaleFactors out;
  if (record.size() < 200 || record.i_alphabeta.empty()) return out;
  const ReadLog log(record, facts, as);
  if (record.has_voltage_equation()) fit_voltage(record, facts, log, out);
  fit_torque(record, facts, log, out);
  return out;
}

}  // namespace twinrate
