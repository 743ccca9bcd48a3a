#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "identify/segmented_fit.hpp"
#include "identify/spin_fits.hpp"

namespace twinrate {
namespace {

constexpr Eigen::Index kLag = 2 + kLevelCount;  // column of FluxFit
constexpr int kHarmonics = 4;                   // columns after it

// Within a tick the voltage is constant in stator axes while the EMF turns, and near zero current
// the loss of the inverter is a large resistance. Therefore the currents are integrated over the
// tick, in rotor axes:
//   L_d i_d' = u_d - R_s i_d - drop_d + omega L_q i_q
//   L_q i_q' = u_q - R_s i_q - drop_q - omega (L_d i_d + psi_f)
Tick inside_tick(const Identified& f, const Row& before, const Row& row, double T_s) {
  constexpr double kFar = 4;  // of i_linear
  const double from = f.n_p * (before.theta - f.theta_zero);
  const double omega = f.n_p * (row.theta - before.theta) / T_s;
  const double L_d = f.L_d.value, L_q = f.L_q.value, R = f.R_s.value;
  const bool is_far = f.loss.V.value == 0 ||
                      inverse_clarke(before.i).cwiseAbs().minCoeff() > kFar * f.loss.i_linear;
  const double stiffness =
      T_s * (R + (is_far ? 0 : f.loss.V.value / f.loss.i_linear)) / std::min(L_d, L_q);
  const int n = std::clamp(static_cast<int>(4 * stiffness), 6, 60);
  const double dt = T_s / n;
  Vec2 d(std::cos(from), std::sin(from));  // the d axis
  const Vec2 half(std::cos(0.5 * omega * dt), std::sin(0.5 * omega * dt));
  const auto turn = [&](const Vec2& x) {
    return Vec2(x[0] * half[0] - x[1] * half[1], x[0] * half[1] + x[1] * half[0]);
  };
  const auto in_stator = [](const Vec2& i_dq, const Vec2& axis) {
    return Vec2(i_dq[0] * axis[0] - i_dq[1] * axis[1], i_dq[0] * axis[1] + i_dq[1] * axis[0]);
  };
  const auto slope = [&](const Vec2& i_dq, const Vec2& axis) {
    const Vec2 u = row.u - f.loss.drop(in_stator(i_dq, axis));
    const double u_d = u.dot(axis), u_q = u[1] * axis[0] - u[0] * axis[1];
    return Vec2((u_d - R * i_dq[0] + omega * L_q * i_dq[1]) / L_d,
                (u_q - R * i_dq[1] - omega * (L_d * i_dq[0] + f.psi_f.value)) / L_q);
  };
  const Vec2 begin = park(before.i, from);
  Vec2 i = begin, sum = Vec2::Zero(), drops = Vec2::Zero();
  double sum_q = 0;
  for (int k = 0; k < n; ++k) {
    const Vec2 middle = i + 0.5 * dt * slope(i, d);
    d = turn(d);
    const Vec2 at = in_stator(middle, d);
    sum += at / n, sum_q += middle[1] / n, drops += f.loss.drop(at) / n;
    i += dt * slope(middle, d);
    d = turn(d);
  }
  return {sum - 0.5 * (before.i + in_stator(i, d)), sum_q - 0.5 * (begin[1] + i[1]), drops};
}

std::vector<Tick> inside_ticks(const Identified& f, const Rows& rows, double T_s) {
  std::vector<Tick> ticks(rows.size());
  for (std::size_t k = 1; k < rows.size(); ++k) {
    Row at = rows[k], before = rows[k - 1];
    const double step = 0.5 * T_s * speed_about(rows, k, T_s),
                 mean = 0.5 * (at.theta + before.theta);
    before.theta = mean - step, at.theta = mean + step;  // without the steps of the encoder
    ticks[k] = inside_tick(f, before, at, T_s);
  }
  return ticks;
}

void advance_angles(Rows& rows, double lag, double T_s) {
  if (rows.size() < 2) return;
  std::vector<double> speeds;
  for (std::size_t k = 0; k < rows.size(); ++k) speeds.push_back(speed_about(rows, k, T_s));
  for (std::size_t k = 0; k < rows.size(); ++k) rows[k].theta += lag * speeds[k];
}

// Columns: psi_d, psi_x, L_q of each level, psi_f times the lag of the angle, harmonics of the flux in
// rotor axes: d and q, cos and sin of six times the electrical angle.
class FluxFit {
 public:
  FluxFit(const Experiment& e, const Identified& found)
      : fit_(3 + kLevelCount + kHarmonics), found_(found), T_s_(e.T_s()) {}

  void add(const SpinRun& segment) {
    constexpr std::size_t kPiece = 4000;
    const Rows& rows = segment.rows;
    for (std::size_t begin = 0; begin + kLeastRows < rows.size(); begin += kPiece)
      add_piece(segment, begin, std::min(begin + kPiece, rows.size()));
  }
  SegmentedFit::Solution solve(const std::vector<Eigen::Index>& used) const {
    return fit_.solve(used);
  }

 private:
  double theta_e(const Row& row) const { return found_.n_p * (row.theta - found_.theta_zero); }

  void add_piece(const SpinRun& segment, std::size_t begin, std::size_t end) {
    const auto n = static_cast<Eigen::Index>(end - begin);
    Eigen::MatrixXd local = Eigen::MatrixXd::Zero(2 * n, 4);
    Eigen::MatrixXd shared = Eigen::MatrixXd::Zero(2 * n, kLag + 1 + kHarmonics);
    Eigen::VectorXd y(2 * n);
    Vec2 psi = Vec2::Zero();
    for (Eigen::Index k = 0; k < n; ++k) {
      const std::size_t row = begin + static_cast<std::size_t>(k);
      if (k > 0) psi += T_s_ * emf_between(segment, row);
      put_row(segment, row, psi, shared.middleRows<2>(2 * k), y.segment<2>(2 * k));
      for (int axis = 0; axis < 2; ++axis) {
        local(2 * k + axis, axis) = 1;
        local(2 * k + axis, 2 + axis) = static_cast<double>(k) / static_cast<double>(n);
      }
    }
    fit_.add(local, shared, y);
  }

  // The mean of u - drop - R_s i between the row before and this one.
  Vec2 emf_between(const SpinRun& segment, std::size_t k) const {
    const Row &row = segment.rows[k], &before = segment.rows[k - 1];
    // Mean of a vector that turns by 2x: the mean of its ends times tan(x)/x.
    const double x = 0.5 * (theta_e(row) - theta_e(before));
    const double bend = std::abs(x) < 1e-6 ? 1 : std::tan(x) / x;
    Vec2 i = 0.5 * bend * (row.i + before.i), drop = found_.loss.drop(i);
    if (!segment.ticks.empty()) {
      const Tick& tick = segment.ticks[k];
      i += tick.bow, drop = tick.drop;
    }
    return row.u - drop - found_.R_s.value * i;
  }

  // The regressors and the flux of a row, in alpha and beta.
  void put_row(const SpinRun& segment, std::size_t k, const Vec2& psi,
               Eigen::Ref<Eigen::MatrixXd, 0, Eigen::OuterStride<>> shared,
               Eigen::Ref<Eigen::VectorXd> y) const {
    const Row& row = segment.rows[k];
    const double theta = theta_e(row);
    const double omega_e = found_.n_p * speed_about(segment.rows, k, T_s_);
    const Vec2 i_dq = park(row.i, theta);
    const Vec2 known = inverse_park(Vec2(found_.L_d.value * i_dq[0], 0), theta);
    for (int r = 0; r < 2; ++r) {
      y[r] = psi[r] - known[r];
      shared(r, 0) = inverse_park(Vec2(1, 0), theta)[r];
      shared(r, 1) = inverse_park(Vec2(0, 1), theta)[r];
      shared(r, kLag) = omega_e * shared(r, 1);
      for (int column = 0; column < kHarmonics; ++column)
        shared(r, kLag + 1 + column) =
            shared(r, column / 2) * (column % 2 == 0 ? std::cos(6 * theta) : std::sin(6 * theta));
      const double along_q = inverse_park(Vec2(0, i_dq[1]), theta)[r];
      if (segment.level >= 0)
        shared(r, 2 + segment.level) = along_q;
      else
        y[r] -= found_.L_q.value * along_q;
    }
  }

  SegmentedFit fit_;
  const Identified& found_;
  double T_s_;
};

// The EMF of the harmonics drives currents that brake, a torque that the model of the motion does
// not contain.
void note_flux_harmonics(const FluxFit& flux, std::vector<Eigen::Index> used, Identified& found) {
  constexpr double kSigmas = 5, kMaterial = 5e-3;  // of psi_f
  // Harmonics of 3 % made B 70 % too large (docs/identify-a-motor.md).
  constexpr double kFrictionAShare = 30;
  for (int column = 0; column < kHarmonics; ++column) used.push_back(kLag + 1 + column);
  const auto s = flux.solve(used);
  const double share = s.x.tail<kHarmonics>().norm() / found.psi_f.value;
  const double sigma = s.sigma.tail<kHarmonics>().norm() / found.psi_f.value;
  if (share < kMaterial || share < kSigmas * sigma) return;
  found.flux_harmonics = share;
  found.friction_share = std::min(1.0, kFrictionAShare * share);
  found.notes.push_back(fmt::format(
      "friction may be shifted: the flux linkage has harmonics, {:.2g} % of psi_f at order {} a "
      "turn; their currents brake, and B_Nms and the Coulomb torque take that for friction",
      100 * share, 6 * found.n_p));
}

// Lag of the angle against the currents, s.
Found lag_of(const FluxFit& flux, const std::vector<Eigen::Index>& used) {
  const auto s = flux.solve(used);
  const double psi = std::hypot(s.x[0], s.x[1]);
  return {s.x[kLag] / psi, s.sigma[kLag] / psi};
}

// psi_f, the zero of the angle, and L_q over its current, from the columns `used` of the fit.
void take_flux(const Experiment& e, const FluxFit& flux, const std::vector<Eigen::Index>& used,
               Identified& found) {
  // Errors of R_s and of the angle's zero cause errors of the flux: in L_q at its current and in
  // psi_f, here as shares of psi_f. The loss of the inverter causes an error of psi_f, a share of
  // its voltage over the speed. The values come from 35 drawn drives, whose errors were up to 12
  // sigmas of the jackknife alone.
  constexpr double kFluxError = 1e-3, kErrorOfPsi = 5e-5, kErrorOfLoss = 0.04;
  const auto solution = flux.solve(used);
  const auto &x = solution.x, &sigma = solution.sigma;
  const double psi = std::hypot(x[0], x[1]);
  const double of_loss =
      kErrorOfLoss * std::abs(found.loss.V.value) / (found.n_p * std::max(found.omega_m_max, 1e-9));
  found.psi_f = {psi, std::hypot(sigma[0], kErrorOfPsi * psi, of_loss)};
  found.theta_zero += std::atan2(x[1], x[0]) / found.n_p;
  found.L_q_points.resize(1);  // keeps the point of standstill
  for (const Eigen::Index column : used) {
    if (column < 2 || column == kLag) continue;
    const double i = kLevels[column - 2] * e.i_max();
    const double error = std::hypot(sigma[column], kFluxError * found.psi_f.value / i);
    found.L_q_points.push_back({i, {x[column], error}, false});
  }
}

}  // namespace

void find_flux(const Experiment& e, std::vector<SpinRun>& segments, Identified& found) {
  constexpr double kSigmas = 5, kLagMaterial = 0.03;  // of a tick
  // From the second pass on the zero of the angle is corrected, from the third on its lag.
  bool is_late = false;
  for (int pass = 0; pass < (is_late ? 4 : 2); ++pass) {
    FluxFit flux(e, found);
    std::vector<Eigen::Index> used = {0, 1};
    for (const SpinRun& s : segments) {
      flux.add(s);
      const Eigen::Index column = 2 + s.level;
      if (s.level >= 0 && s.rows.size() > kLeastRows &&
          std::count(used.begin(), used.end(), column) == 0)
        used.push_back(column);
    }
    if (is_late || pass == 1) {
      std::vector<Eigen::Index> with = used;
      with.push_back(kLag);
      const Found lag = lag_of(flux, with);
      if (pass == 1)
        is_late = std::abs(lag.value) > kSigmas * lag.sigma &&
                  std::abs(lag.value) > kLagMaterial * e.T_s();
      if (is_late) {
        used = with;
        found.angle_lag = {found.angle_lag.value + lag.value, lag.sigma};
        for (SpinRun& run : segments) advance_angles(run.rows, lag.value, e.T_s());
      }
    }
    take_flux(e, flux, used, found);
    if (pass == 0 || is_late)
      for (SpinRun& s : segments) s.ticks = inside_ticks(found, s.rows, e.T_s());
    if (pass + 1 == (is_late ? 4 : 2)) note_flux_harmonics(flux, used, found);
  }
}

}  // namespace twinrate
