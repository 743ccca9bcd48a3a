#include "estimator/propagated_gain.hpp"

#include <algorithm>
#include <cmath>

#include "estimator/gain_frame.hpp"

namespace twinrate {
namespace {

constexpr int kSpeeds = 5;
constexpr double kSlowest = 0.0125;  // of the span: 10 rad/s of 800

// +1 if an element of S is even in the direction of rotation.
double mirror(int row, int pairs) {
  return row < 2 * pairs && row % 2 == 0 ? 1 : -1;
}

}  // namespace

// P of step k-1 belongs to the axes of tick k-1, which the rotor has left by omega_e T_s.
Gain Filter::background_steps(const Gain& gain, double omega_m, int ticks) const {
  const Estimate at = *steady_state(omega_m);
  const GainFrame back(turning_pairs(), at.theta_e - ahead(at, 1).theta_e);
  Gain later = gain;
  for (int i = 0; i < ticks; ++i) {
    back.turn_covariance(later);
    later = background_step(later, at);
  }
  return later;
}

bool offers_propagated(const Filter& filter) {
  return filter.turning_pairs() > 0 && filter.steady_state(0) &&
         filter.initial_gain().n_x <= kMaxTurningStates;
}

Gain propagated_background(const Filter& filter, const Gain& previous, double omega_m_before,
                           const Estimate& snapshot, int n, double span_omega_m) {
  const int pairs = filter.turning_pairs();
  const bool first = previous.k < 0;
  Gain rotor = previous;
  if (!first) GainFrame(pairs, -previous.theta_e).turn_covariance(rotor);
  rotor = filter.background_steps(
      rotor, first ? snapshot.omega_m : 0.5 * (omega_m_before + snapshot.omega_m),
      first ? 1
            : static_cast<int>(std::clamp<std::int64_t>(snapshot.k - previous.k, 1, 1'000'000)));

  Gain gain = rotor;
  gain.k = snapshot.k;
  gain.t_ns = snapshot.t_ns;
  gain.theta_e = snapshot.theta_e;
  gain.n_speeds = kSpeeds;
  const double direction = snapshot.omega_m < 0 ? -1 : 1, omega = std::abs(snapshot.omega_m);
  const double slowest = kSlowest * span_omega_m;
  const double low = std::max(slowest, omega - span_omega_m), top = omega + span_omega_m;
  for (int i = 0; i < kSpeeds; ++i) {
    const double share = static_cast<double>(i) / (kSpeeds - 1);
    GainAtSpeed& node = gain.at_speed[static_cast<std::size_t>(i)];
    node.omega_m = direction * (low + (top - low) * share * share);
    node.K =
        filter.background_steps(rotor, node.omega_m, n).K.topLeftCorner<kMaxTurningStates, 2>();
  }
  const GainFrame turned(pairs, snapshot.theta_e);
  turned.turn_gain(gain);
  turned.turn_covariance(gain);
  return gain;
}

void use_at_speed(int pairs, double omega_m, double theta_e, Gain& gain) {
  if (gain.n_speeds < 2) return;
  const double omega = std::isfinite(omega_m) ? std::abs(omega_m) : 0.0;
  const auto& node = gain.at_speed;
  std::size_t i = 0;
  while (i + 2 < static_cast<std::size_t>(gain.n_speeds) && omega > std::abs(node[i + 1].omega_m))
    ++i;
  const double low = std::abs(node[i].omega_m), high = std::abs(node[i + 1].omega_m);
  const double share = std::clamp((omega - low) / (high - low), 0.0, 1.0);
  const bool other_way = omega_m * node[1].omega_m < 0;
  for (int row = 0; row < gain.n_x; ++row)
    for (int col = 0; col < 2; ++col) {
      const double K =
          node[i].K(row, col) + share * (node[i + 1].K(row, col) - node[i].K(row, col));
      gain.K(row, col) = other_way ? K * mirror(row, pairs) * mirror(col, 1) : K;
    }
  GainFrame(pairs, theta_e).turn_gain(gain);
}

}  // namespace twinrate
