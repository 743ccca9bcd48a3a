#include "plant_sim/switched_inverter.hpp"

#include <algorithm>

#include "model/effects/shapes.hpp"

namespace twinrate {

Vec2 LegStates::u_alphabeta(const Vec3& i_abc, double v_dc) const {
  Vec3 v_leg;
  for (int phase = 0; phase < 3; ++phase) {
    const Leg leg = legs[static_cast<std::size_t>(phase)];
    v_leg[phase] = leg == Leg::kHigh  ? v_dc
                   : leg == Leg::kLow ? 0
                                      : 0.5 * v_dc * (1 - saturate(i_abc[phase] / i_zero));
  }
  return clarke(v_leg);
}

Leg SwitchedInverter::LegPlan::state(double t) const {
  if (t >= low_again || (t >= low_from && t < rise)) return Leg::kLow;
  return t >= high_from && t < fall ? Leg::kHigh : Leg::kDead;
}

SwitchedInverter::LegPlan SwitchedInverter::plan(const LegPlan& before, double duty) const {
  const double never = 2 * T_pwm_;
  if (duty >= 1)
    return {.low_from = never,
            .rise = 0,
            .high_from = before.high_at_end ? 0 : t_d_,
            .fall = never,
            .low_again = never,
            .high_at_end = true};
  // The dead time after a fall just before the end of the last period may still run.
  const double low_from = before.high_at_end ? t_d_ : std::max(0.0, before.low_again - T_pwm_);
  if (duty <= 0)
    return {.low_from = low_from,
            .rise = never,
            .high_from = never,
            .fall = never,
            .low_again = T_pwm_};
  const double rise = 0.5 * T_pwm_ * (1 - duty), fall = 0.5 * T_pwm_ * (1 + duty);
  return {.low_from = low_from,
          .rise = rise,
          .high_from = rise + t_d_,
          .fall = fall,
          .low_again = fall + t_d_};
}

std::span<const Segment> SwitchedInverter::next_period(const Vec3& duty_abc) {
  std::array<double, 16> edges{};  // 5 a leg, and the end
  std::size_t count = 0;
  for (std::size_t leg = 0; leg < 3; ++leg) {
    const LegPlan& p = plans_[leg] = plan(plans_[leg], duty_abc[static_cast<Eigen::Index>(leg)]);
    for (double edge : {p.low_from, p.rise, p.high_from, p.fall, p.low_again})
      if (edge > 0 && edge < T_pwm_) edges[count++] = edge;
  }
  edges[count++] = T_pwm_;
  std::sort(edges.begin(), edges.begin() + static_cast<std::ptrdiff_t>(count));
  // Edges closer than this are one edge.
  const double shortest = 1e-9 * T_pwm_;
  std::size_t segments = 0;
  double t = 0;
  for (std::size_t i = 0; i < count; ++i) {
    if (edges[i] - t < shortest && i + 1 < count) continue;
    Segment& segment = segments_[segments++];
    segment.t_start = t;
    segment.T = edges[i] - t;
    for (std::size_t leg = 0; leg < 3; ++leg)
      segment.states.legs[leg] = plans_[leg].state(t + 0.5 * segment.T);
    segment.states.i_zero = i_zero_;
    t = edges[i];
  }
  return {segments_.data(), segments};
}

}  // namespace twinrate
