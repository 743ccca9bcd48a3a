#include "loop/stale_gain.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "estimator/gain_frame.hpp"
#include "model/linear_algebra.hpp"
#include "model/math.hpp"

namespace twinrate {
namespace {

using Square = Eigen::MatrixXd;

constexpr double kDifference = 1e-6;  // of a state, for central differences
constexpr int kMaxPeriods = 400;      // until the gain is periodic in rotor axes
constexpr int kMinPeriods = 11;
constexpr int kMaxPropagatedTicks = 2000;  // propagated: P takes a step every tick, whatever n
constexpr double kGainTolerance = 1e-9;    // relative change of a periodic gain

// The steady state at tick k.
Estimate at_tick(const Steady& s, std::int64_t k) {
  Estimate e = s.filter->ahead(*s.filter->steady_state(s.omega_m), static_cast<double>(k));
  e.k = k;
  return e;
}

// The sample after `at`, without load. dq_ekf needs its voltages, because it turns them with its own
// angle; its state carries them. Filters that measure the angle need it to correct at all. The steps of
// the others are affine in their samples.
Measurement sample_after(const Steady& s, const Estimate& at) {
  Measurement m{.signals = kPhaseCurrents | kVoltage};
  if (s.filter->kind() == "dq_ekf")
    m.u_alphabeta =
        inverse_park(Vec2(at.x_hat.segment<2>(4)), at.theta_e + 0.5 * s.omega_e * s.T_s);
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
    Eigen::VectorXd change = (up.x_hat - down.x_hat).head(n_x);
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
  Gain rotor;
  auto K_before = rotor.K;
  const int periods = s.policy == GainPolicy::kPropagated
                          ? std::clamp(kMaxPropagatedTicks / n, kMinPeriods + 1, kMaxPeriods)
                          : kMaxPeriods;
  for (int period = 0; period < periods; ++period) {
    copy_gain(rotor, background.step(at_tick(s, static_cast<std::int64_t>(period) * n)));
    GainFrame(s.filter->turning_pairs(), -rotor.theta_e).turn_gain(rotor);
    const bool repeats = (rotor.K - K_before).lpNorm<Eigen::Infinity>() <=
                         kGainTolerance * rotor.K.lpNorm<Eigen::Infinity>();
    K_before = rotor.K;
    if (repeats && period >= kMinPeriods) break;
  }
  return background.last();
}

Gain periodic_gain(const Steady& s, int n) {
  if (!s.found) return find_periodic_gain(s, n);
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

// The gains of one period as they are used, in the stator; `first`: the tick of the first one.
static std::vector<Gain> gains_of_period(const Steady& s, int n, std::int64_t& first) {
  const bool background = has_background(s.policy);
  const Gain gain = background ? periodic_gain(s, n) : Gain{};
  const auto table = background ? nullptr : GainSchedule::build(*s.filter, 2 * std::abs(s.omega_m));
  first = background ? first_use_of(s.policy, gain.k, n) : 1;
  std::vector<Gain> gains;
  for (std::int64_t k = first; k < first + n; ++k) {
    const Estimate before = at_tick(s, k - 1);
    Gain used = table ? table->at(s.omega_m, before.theta_e) : gain;
    if (!table) turn_for_use(s.policy, *s.filter, before, used);
    gains.push_back(used);
  }
  return gains;
}

std::vector<Gain> rotor_gains_of_period(const Steady& s, int n) {
  std::int64_t k = 0;
  std::vector<Gain> gains = gains_of_period(s, n, k);
  for (Gain& gain : gains)
    GainFrame(s.filter->turning_pairs(), -at_tick(s, k++ - 1).theta_e).turn_gain(gain);
  return gains;
}

double spectral_radius(const Steady& s, int n) {
  std::int64_t first = 0;
  const std::vector<Gain> gains = gains_of_period(s, n, first);
  const int n_x = at_tick(s, 0).n_x, pairs = s.filter->turning_pairs();
  Square monodromy = Square::Identity(n_x, n_x);
  for (int i = 0; i < n; ++i)
    monodromy = error_dynamics(s, at_tick(s, first + i - 1), gains[static_cast<std::size_t>(i)]) *
                monodromy;
  const double turned = at_tick(s, first + n).theta_e - at_tick(s, first).theta_e;
  return linear::eigenvalues(turn(n_x, pairs, -turned) * monodromy).cwiseAbs().maxCoeff();
}

int n_max_by_floquet(const Steady& s, int limit) {
  for (int n = 1; n <= limit; ++n)
    if (spectral_radius(s, n) >= 1) return n - 1;
  return limit;
}

}  // namespace twinrate
