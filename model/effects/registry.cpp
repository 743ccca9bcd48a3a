#include "model/effects/registry.hpp"

#include <iterator>

namespace twinrate {
namespace {

struct Entry {
  std::string_view kind;
  std::shared_ptr<Effect> (*make)();
};
constexpr Entry kEntries[] = {
    {"adc_clipping", make_adc_clipping},
    {"adc_quantisation", make_adc_quantisation},
    {"backlash", make_backlash},
    {"cogging", make_cogging},
    {"constant_load", make_constant_load},
    {"coulomb_friction", make_coulomb_friction},
    {"cross_saturation", make_cross_saturation},
    {"current_gain", make_current_gain},
    {"current_offset", make_current_offset},
    {"dc_bus_ripple", make_dc_bus_ripple},
    {"dead_time", make_dead_time},
    {"eccentric_load", make_eccentric_load},
    {"encoder_eccentricity", make_encoder_eccentricity},
    {"encoder_offset", make_encoder_offset},
    {"fan_load", make_fan_load},
    {"flux_harmonics", make_flux_harmonics},
    {"flux_linkage", make_flux_linkage},
    {"friction_ripple", make_friction_ripple},
    {"inductance", make_inductance},
    {"inertia", make_inertia},
    {"inverter_drop", make_inverter_drop},
    {"inverter_offset", make_inverter_offset},
    {"iron_loss", make_iron_loss},
    {"load_step", make_load_step},
    {"missing_samples", make_missing_samples},
    {"periodic_torque", make_periodic_torque},
    {"phase_asymmetry", make_phase_asymmetry},
    {"resistance", make_resistance},
    {"saturation", make_saturation},
    {"signal_lag", make_signal_lag},
    {"stale_samples", make_stale_samples},
    {"stribeck_friction", make_stribeck_friction},
    {"torsion", make_torsion},
    {"viscous_friction", make_viscous_friction},
    {"voltage_gain", make_voltage_gain},
};

}  // namespace

std::shared_ptr<Effect> make_effect(std::string_view kind) {
  for (const Entry& entry : kEntries)
    if (entry.kind == kind) return entry.make();
  return nullptr;
}

std::vector<std::string> effect_kinds() {
  std::vector<std::string> kinds;
  for (const Entry& entry : kEntries) kinds.emplace_back(entry.kind);
  return kinds;
}

}  // namespace twinrate
