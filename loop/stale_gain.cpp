#include "loop/stale_gain.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "estimator/gain_frame.hpp"
#include "model/linear_algebra.hpp"
#include "model/math.hpp"

namespace twinrate {
namespace {

using Square = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxStates, kMaxStates>;
using Column = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxStates, 1>;

constexpr double kDifference = 1e-6;  // of a state, for central differences
constexpr int kMaxPeriods = 400;      // until the gain is periodic in rotor axes
constexpr int kMinPeriods = 11;
constexpr int kMaxPropagatedTicks = 2000;  // propagated: P takes a step every tick, for any n
constexpr double kGainTolerance = 1e-9;    // relative change of a periodic gain

Estimate at_begin(const Steady& s) {
  return s.at ? *s.at : *s.filter->steady_state(s.omega_m);
}

// The steady state `begin`, at tick k.
Estimate at_tick(const Steady& s, const Estimate& begin, std::int64_t k) {
  Estimate e = s.filter->ahead(begin, static_cast<double>(k));
  e.k = k;
  return e;
}

// The sample after `at`, at the same load. A filter whose state carries its voltages needs them, because it
// turns them with its own angle. Filters that measure the angle need it to correct at all. The steps of
// the others are affine in their samples.
Measurement sample_after(const Steady& s, const Estimate& at) {
  Measurement m{.signals = kPhaseCurrents | kVoltage};
  m.i_abc = inverse_clarke(inverse_park(at.i_dq, at.theta_e + s.omega_e * s.T_s));
  if (const int u_dq = s.filter->voltage_state(); u_dq >= 0)
    m.u_alphabeta =
        inverse_park(Vec2(at.x_hat.segment<2>(u_dq)), at.theta_e + 0.5 * s.omega_e * s.T_s);
  if (at.status & kMeasuredAngle) {
    m.signals |= kPosition | kSpeed;
    m.theta_m = s.omega_m * s.T_s;
    m.omega_m = s.omega_m;
  }
  return m;
}

// d x_hat(k+1)/d x_hat(k) of the fast step with this gain, by central differences.
Square error_dynamics(const Steady& s, const Estimate& at, const Gain& gain) {
  const int n_x = at.n_x;
  Square jacobian(n_x, n_x);
  for (int col = 0; col < n_x; ++col) {
    FastState up, down;
    up.x_hat = down.x_hat = at.x_hat;
    up.emf_angle = down.emf_angle = emf_angle_at(at.theta_e, s.omega_e);
    up.x_hat[col] += kDifference;
    down.x_hat[col] -= kDifference;
    const Measurement m = sample_after(s, at);
    s.filter->fast_step(up, m, gain);
    s.filter->fast_step(down, m, gain);
    Column change = (up.x_hat - down.x_hat).head(n_x);
    for (double& c : change)  // unwraps an angle
      if (std::abs(c) > kPi) c -= std::copysign(kTwoPi, c);
    jacobian.col(col) = change / (2 * kDifference);
  }
  return jacobian;
}

// T(angle) = diag(R(angle), .., I).
Square turn(int n_x, int pairs, double angle) {
  Square T = Square::Identity(n_x, n_x);
  const auto [s, c] = math::sincos(angle);
  for (int pair = 0; pair < pairs; ++pair) T.block<2, 2>(2 * pair, 2 * pair) << c, -s, s, c;
  return T;
}

// Runs the background in steady state until its gain is periodic; returns the last gain.
Gain find_periodic_gain(const Steady& s, int n) {
  BackgroundLoop background(s.filter, s.policy, n, s.span_omega_m);
  const Estimate begin = at_begin(s);
  Gain rotor;
  auto K_before = rotor.K;
  const int periods = s.policy == GainPolicy::kPropagated
                          ? std::clamp(kMaxPropagatedTicks / n, kMinPeriods + 1, kMaxPeriods)
                          : kMaxPeriods;
  for (int period = 0; period < periods; ++period) {
    copy_gain(rotor, background.step(at_tick(s, begin, static_cast<std::int64_t>(period) * n)));
    GainFrame(s.filter->turning_pairs(), -rotor.theta_e).turn_gain(rotor);
    const bool repeats = (rotor.K - K_before).lpNorm<Eigen::Infinity>() <=
                         kGainTolerance * rotor.K.lpNorm<Eigen::Infinity>();
    K_before = rotor.K;
    if (repeats && period >= kMinPeriods) break;
  }
  return background.last();
}

const Gain& periodic_gain(const Steady& s, int n) {
  const auto known = s.found->find(n);
  if (known != s.found->end()) return known->second;
  return s.found->emplace(n, find_periodic_gain(s, n)).first->second;
}

}  // namespace

double critical_angle(const Steady& s, int n) {
  if (s.filter->kind() != "ekf_sensorless") return std::numeric_limits<double>::quiet_NaN();
  Gain gain = periodic_gain(s, n);
  GainFrame(1, -gain.theta_e).turn_gain(gain);
  const double k3d = gain.K(2, 0), k3q = gain.K(2, 1), k4d = gain.K(3, 0), k4q = gain.K(3, 1);
  return math::atan2(s.omega_e * k4d - k3q, -(s.omega_e * k4q + k3d));
}

int n_max_by_formula(const Steady& s, int limit) {
  const double share = s.policy == GainPolicy::kPaper       ? 2.0 / 3
                       : s.policy == GainPolicy::kImmediate ? 2.0
                                                            : 0;
  if (share == 0 || std::isnan(critical_angle(s, 1))) return 0;
  for (int n = 1; n <= limit; ++n)
    if (n > 1 + share * critical_angle(s, n) / (s.omega_e * s.T_s)) return n - 1;
  return limit;
}

namespace {

// The gains of one period as they are used, in the stator, tick by tick.
class GainsOfPeriod {
 public:
  GainsOfPeriod(const Steady& s, int n) : s_(s) {
    if (has_background(s.policy))
      gain_ = used_ = periodic_gain(s, n);
    else
      table_ = GainSchedule::build(*s.filter, 2 * std::abs(s.omega_m));
    first_ = table_ ? 1 : first_use_of(s.policy, gain_.k, n);
  }
  // The tick of the first one.
  std::int64_t first() const { return first_; }
  // The gain that corrects the tick after `before`; valid until the next call.
  const Gain& after(const Estimate& before) {
    if (table_) return used_ = table_->at(s_.omega_m, before.theta_e);
    copy_gain(used_, gain_);
    turn_for_use(s_.policy, *s_.filter, before, used_);
    return used_;
  }

 private:
  const Steady& s_;
  Gain gain_, used_;
  std::shared_ptr<const GainSchedule> table_;
  std::int64_t first_ = 1;
};

}  // namespace

std::vector<Gain> rotor_gains_of_period(const Steady& s, int n) {
  const Estimate begin = at_begin(s);
  GainsOfPeriod period(s, n);
  std::vector<Gain> gains;
  gains.reserve(static_cast<std::size_t>(n));
  for (std::int64_t k = period.first(); k < period.first() + n; ++k) {
    const Estimate before = at_tick(s, begin, k - 1);
    gains.push_back(period.after(before));
    GainFrame(s.filter->turning_pairs(), -before.theta_e).turn_gain(gains.back());
  }
  return gains;
}

double spectral_radius(const Steady& s, int n) {
  const Estimate begin = at_begin(s);
  GainsOfPeriod period(s, n);
  const int n_x = begin.n_x, pairs = s.filter->turning_pairs();
  Square monodromy = Square::Identity(n_x, n_x);
  for (std::int64_t k = period.first(); k < period.first() + n; ++k) {
    const Estimate before = at_tick(s, begin, k - 1);
    monodromy = error_dynamics(s, before, period.after(before)) * monodromy;
  }
  const double turned =
      at_tick(s, begin, period.first() + n).theta_e - at_tick(s, begin, period.first()).theta_e;
  return linear::eigenvalues(turn(n_x, pairs, -turned) * monodromy).cwiseAbs().maxCoeff();
}

int n_max_by_floquet(const Steady& s, int limit) {
  for (int n = 1; n <= limit; ++n)
    if (spectral_radius(s, n) >= 1) return n - 1;
  return limit;
}

}  // namespace twinrate
