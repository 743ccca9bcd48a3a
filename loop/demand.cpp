#include "loop/demand.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "controller/controller.hpp"
#include "controller/current_reference.hpp"
#include "core/field_list.hpp"
#include "loop/slips.hpp"

namespace twinrate {
namespace {

double largest(const Profile& profile) {
  double amplitude = 0;
  for (const ProfileStep& step : profile.steps())
    amplitude = std::max(amplitude, std::abs(step.value));
  return amplitude;
}

// Properties of the controller that the demand uses: current limit, current angle, bandwidths.
void read_controller(Config& config, Demand& demand) {
  const std::string kind = config.drive().controller.kind;
  const auto builder = controller_builder(kind, config.drive());
  const auto fields = [&](FieldVisitor& f) { builder->fields(f); };
  config.read_table("controller." + kind, fields);
  for (const FieldRow& row : list_fields(fields)) {
    if (row.key == "i_max_A") demand.i_max = row.value;
    if (row.key == "current_angle") demand.at_mtpa = row.value_text == "mtpa";
    if (row.key == "current_bandwidth_Hz") demand.current_Hz = row.value;
    if (row.key == "speed_bandwidth_Hz") demand.speed_Hz = row.value;
  }
}

}  // namespace

Demand demand_of(Config& config) {
  const DriveConfig& d = config.drive();
  const MachineParameters& m = d.machine;
  Demand demand;
  demand.omega_e = d.reference.in_rpm ? largest(d.reference.speed_rpm) * kTwoPi / 60 * m.n_p
                                      : largest(d.reference.omega_e_rad_s);
  demand.u_max = d.inverter.u_max_linear();
  demand.emf = demand.omega_e * m.psi_f;
  demand.T_load = largest(d.load.T_load_Nm);
  read_controller(config, demand);
  const double T = demand.T_load + m.B * demand.omega_e / m.n_p;
  demand.i_dq = demand.at_mtpa ? mtpa(m, mtpa_for_torque(m, T)) : Vec2(0, T / m.torque_constant());
  const Vec2 &i = demand.i_dq, flux(-m.L_q * i[1], m.L_d * i[0] + m.psi_f);
  demand.u_needed = (m.R_s * i + demand.omega_e * flux).norm();
  if (demand.i_max)
    demand.T_max = demand.at_mtpa ? largest_torque(m, *demand.i_max) : m.torque(0, *demand.i_max);
  return demand;
}

std::vector<std::string> warnings_of(const Config& config, const Demand& demand) {
  const DriveConfig& d = config.drive();
  const MachineParameters& m = d.machine;
  std::vector<std::string> list;
  const std::string speed_key =
      d.reference.in_rpm ? "reference.speed_rpm" : "reference.omega_e_rad_s";
  const auto warn = [&](const std::string& key, const std::string& what) {
    list.push_back(fmt::format("{}: {}: {}", config.where(key), key, what));
  };
  if (demand.u_needed > demand.u_max)
    warn(speed_key, fmt::format("needs {:.4g} V, v_dc allows {:.4g} V; without load this allows "
                                "{:.4g} rad/s electrical",
                                demand.u_needed, demand.u_max, demand.u_max / m.psi_f));
  if (demand.i_max && demand.i_dq.norm() > *demand.i_max)
    warn("load.T_load_Nm",
         fmt::format("needs {:.4g} A, i_max_A is {:.4g} A", demand.i_dq.norm(), *demand.i_max));
  if (demand.i_max && m.i_trip > 0 && m.i_trip < *demand.i_max)
    warn("machine.i_trip_A", fmt::format("{:.4g} A, the drive switches off below i_max_A, {:.4g} A",
                                         m.i_trip, *demand.i_max));
  if (m.omega_m_rated > 0 && demand.omega_e > m.n_p * m.omega_m_rated)
    warn(speed_key,
         fmt::format("above the rated speed, {:.4g} rad/s electrical", m.n_p * m.omega_m_rated));
  const double samples = d.rates.f_s_Hz / (demand.omega_e / kTwoPi);
  if (samples < 10)
    warn("rates.f_s_Hz",
         fmt::format("only {:.3g} samples an electrical turn at the reference speed", samples));
  const double decay = d.T_s() * m.R_s / std::min(m.L_d, m.L_q);
  if (d.estimator.prediction == Prediction::kEuler && decay > 1)
    warn("estimator.prediction",
         fmt::format("Euler on currents: R_s/(L f_s) = {:.3g} {}, use exact or rk4", decay,
                     decay > 2 ? "is unstable" : "overshoots"));
  for (const Slip& slip : slips_of(d, demand.current_Hz, demand.speed_Hz))
    warn(slip.key, slip.what);
  return list;
}

}  // namespace twinrate
