#include "bench/blind/drawn_hidden.hpp"

#include <cmath>

namespace twinrate::blind {
namespace {

double sign(double x) {
  return std::tanh(x);
}

using Draws = HiddenEffect (*)(Draw& d, const DrawnMachine& x);

double torque(Draw& d, const DrawnMachine& x) {
  return d.log_between(0.01, 0.06) * x.machine.T_rated;
}
// Speed below which a friction is smooth.
double slow(const DrawnMachine& x) {
  return 0.002 * x.machine.omega_m_rated;
}

HiddenEffect fractional_order(Draw& d, const DrawnMachine& x) {
  const double A = torque(d, x), nu = d.whole(1, 9) + d.between(0.2, 0.8), phase = d.phase();
  return {.name = "torque of an order that is not whole",
          .depends_on = "theta_m",
          .torque_Nm = [=](const HiddenPoint& p) { return A * std::sin(nu * p.theta_m + phase); }};
}

HiddenEffect slow_sine(Draw& d, const DrawnMachine& x) {
  const double A = torque(d, x), f = d.log_between(0.3, 3), phase = d.phase();
  return {
      .name = "torque of a slow sine in time",
      .depends_on = "t",
      .torque_Nm = [=](const HiddenPoint& p) { return A * std::sin(kTwoPi * f * p.t + phase); }};
}

HiddenEffect warm_friction(Draw& d, const DrawnMachine& x) {
  const double A = 3 * torque(d, x), tau = d.between(1, 4), w = slow(x);
  return {.name = "friction that fades as it warms",
          .depends_on = "t direction",
          .parts = {"coulomb_friction"},
          .torque_Nm = [=](const HiddenPoint& p) {
            return A * std::exp(-p.t / tau) * sign(p.omega_m / w);
          }};
}

HiddenEffect gear_friction(Draw& d, const DrawnMachine& x) {
  const double A = 3 * torque(d, x) / x.machine.i_rated, w = slow(x);
  return {.name = "friction in proportion to |i_q|",
          .depends_on = "i_q direction",
          .torque_Nm = [=](const HiddenPoint& p) {
            return A * std::abs(p.i_dq[1]) * sign(p.omega_m / w);
          }};
}

HiddenEffect root_friction(Draw& d, const DrawnMachine& x) {
  const double A = 2 * torque(d, x), w = x.machine.omega_m_rated;
  return {.name = "friction with the root of the speed",
          .depends_on = "omega_m direction",
          .parts = {"coulomb_friction", "viscous_friction", "stribeck_friction"},
          .torque_Nm = [=](const HiddenPoint& p) {
            return A * std::sqrt(std::abs(p.omega_m) / w) * sign(p.omega_m / (0.002 * w));
          }};
}

HiddenEffect loaded_ripple(Draw& d, const DrawnMachine& x) {
  const double A = 3 * torque(d, x) / x.machine.i_rated, phase = d.phase();
  const int order = d.whole(2, 3 * x.machine.n_p);
  return {.name = "torque ripple in proportion to i_q",
          .depends_on = "theta_m i_q",
          .parts = {"flux_harmonics"},
          .torque_Nm = [=](const HiddenPoint& p) {
            return A * p.i_dq[1] * std::sin(order * p.theta_m + phase);
          }};
}

HiddenEffect random_load(Draw& d, const DrawnMachine& x) {
  const double A = torque(d, x);
  const auto seed = static_cast<std::uint64_t>(1e6 * d.between(0, 1));
  return {.name = "load that wanders",
          .depends_on = "t",
          .torque_Nm = [=](const HiddenPoint& p) {  // six sines without a common period
            double sum = 0;
            for (std::uint64_t j = 0; j < 6; ++j)
              sum += std::sin(kTwoPi * p.t * (0.7 + 5 * uniform(seed, 3, j)) +
                              kTwoPi * uniform(seed, 4, j));
            return A * sum / 2;
          }};
}

HiddenEffect current_angle(Draw& d, const DrawnMachine& x) {
  const double c = d.signed_between(0.03, 0.12) / x.machine.n_p / x.machine.i_rated;
  return {.name = "angle error in proportion to i_q",
          .depends_on = "i_q i_d omega_m",
          .parts = {"cross_saturation", "saturation", "inductance"},  // a flux turned by i_q
          .angle_rad = [=](const HiddenPoint& p) { return c * p.i_dq[1]; }};
}

HiddenEffect fast_dead_time(Draw& d, const DrawnMachine& x) {
  const double u = d.log_between(0.004, 0.012) * x.v_dc, w = x.machine.omega_m_rated,
               soft = 0.02 * x.machine.i_rated;
  const int n_p = x.machine.n_p;
  return {.name = "dead time that grows with the speed",
          .depends_on = "i_q i_d omega_m theta_m",
          .parts = {"dead_time", "inverter_drop"},
          .voltage_V = [=](const HiddenPoint& p) {
            Vec3 i_abc = inverse_clarke(inverse_park(p.i_dq, n_p * p.theta_m));
            for (double& i : i_abc) i = -u * std::abs(p.omega_m) / w * std::tanh(i / soft);
            return park(clarke(i_abc), n_p * p.theta_m);
          }};
}

HiddenEffect square_voltage(Draw& d, const DrawnMachine& x) {
  const MachineParameters& m = x.machine;
  const double c = d.signed_between(0.05, 0.3) * m.R_s / m.i_rated;
  return {.name = "d voltage with the square of i_q",
          .depends_on = "i_q",
          .voltage_V = [=](const HiddenPoint& p) { return Vec2(c * p.i_dq[1] * p.i_dq[1], 0); }};
}

HiddenEffect turning_voltage(Draw& d, const DrawnMachine& x) {
  const double u = d.log_between(0.002, 0.01) * x.v_dc, phase = d.phase(),
               nu = d.whole(1, 5) + d.between(0.2, 0.8);
  return {.name = "voltage of an order that is not whole",
          .depends_on = "theta_m",
          .voltage_V = [=](const HiddenPoint& p) {
            return Vec2(u * std::sin(nu * p.theta_m + phase), u * std::cos(nu * p.theta_m + phase));
          }};
}

HiddenEffect bent_current(Draw& d, const DrawnMachine& x) {
  const double c = d.signed_between(0.03, 0.1) / x.machine.i_rated;
  return {.name = "current sensors that bend",
          .depends_on = "i_q i_d theta_m",
          .parts = {"current_gain", "saturation"},
          .current_A = [=](double i) { return i * (1 + c * std::abs(i)); }};
}

HiddenEffect ringing_voltage(Draw& d, const DrawnMachine& x) {
  const double u = d.log_between(0.002, 0.01) * x.v_dc, f = d.between(20, 90), phase = d.phase();
  return {.name = "d voltage of a sine in time",
          .depends_on = "t",
          .voltage_V = [=](const HiddenPoint& p) {
            return Vec2(u * std::sin(kTwoPi * f * p.t + phase), 0);
          }};
}

constexpr Draws kDraws[] = {fractional_order, slow_sine,      warm_friction,   gear_friction,
                            root_friction,    loaded_ripple,  random_load,     current_angle,
                            fast_dead_time,   square_voltage, turning_voltage, bent_current,
                            ringing_voltage};

}  // namespace

int hidden_count() {
  return static_cast<int>(std::size(kDraws));
}

HiddenEffect draw_hidden(int which, Draw& d, const DrawnMachine& drawn) {
  return kDraws[which](d, drawn);
}

}  // namespace twinrate::blind
