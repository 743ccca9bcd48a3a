#include "trace/bus_applied.hpp"

#include <algorithm>
#include <cmath>

#include "model/machine.hpp"

namespace twinrate {
namespace {

constexpr double kBusOff = 0.1;  // of the highest voltage in the log

}  // namespace

Record as_applied(Record record, const Effects& effects) {
  const Effects on_bus = acting_on(effects, kOnBus);
  if (on_bus.empty() || record.u_alphabeta.empty() || record.v_dc.empty()) return record;
  const auto [low, high] = std::minmax_element(record.v_dc.begin(), record.v_dc.end());
  const double highest = *high;
  if (*low == highest) return record;  // a set value, without a ripple
  const auto ripple = [&](double t) { return sum_at(on_bus, {.t = t}).v_dc; };
  double end = 0;
  for (std::size_t k = 0; k < record.size(); ++k) {
    const double t = record.t[k];
    const bool goes_on = k > 0 && std::abs(t - record.t[k - 1] - record.T_s) < 1e-9;
    const double start = goes_on ? end : ripple(t);
    end = ripple(t + record.T_s);
    const double change = (end + 4 * ripple(t + 0.5 * record.T_s) - 5 * start) / 6;  // Simpson
    if (record.v_dc[k] > kBusOff * highest) record.u_alphabeta[k] *= 1 + change / record.v_dc[k];
    record.v_dc[k] -= start;
  }
  return record;
}

bool acted(const Record& record, const Record& applied, const MachineParameters& m) {
  if (!record.has_voltage_equation()) return true;
  const auto flux = [&](std::size_t k) {
    const double theta_e = m.n_p * record.theta_m[k];
    const OperatingPoint point{.d_axis = {std::cos(theta_e), std::sin(theta_e)}};
    const Vec2 i_dq = point.rotor_axes(record.i_alphabeta[k]);
    return point.stator_axes({m.L_d * i_dq[0] + m.psi_f, m.L_q * i_dq[1]});
  };
  double product = 0, square = 0;
  Vec2 psi = flux(0);
  for (std::size_t k = 0; k + 1 < record.size(); ++k) {
    const Vec2 next = flux(k + 1);
    if (record.electrical_ok[k] && record.electrical_ok[k + 1]) {
      const Vec2 left = record.u_alphabeta[k] - (next - psi) / record.T_s -
                        0.5 * m.R_s * (record.i_alphabeta[k] + record.i_alphabeta[k + 1]);
      const Vec2 change = applied.u_alphabeta[k] - record.u_alphabeta[k];
      product += left.dot(change);
      square += change.squaredNorm();
    }
    psi = next;
  }
  return square == 0 || product < -0.5 * square;
}

}  // namespace twinrate
