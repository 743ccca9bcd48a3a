// Every effect's maker, one line an effect; its table is in registry.cpp.
#pragma once
#include "model/drive_facts.hpp"
#include "model/effects/portrait.hpp"
#include "model/effects/tracing.hpp"
#include "model/fields.hpp"

namespace twinrate {

std::shared_ptr<Effect> make_adc_clipping();
std::shared_ptr<Effect> make_adc_quantisation();
std::shared_ptr<Effect> make_backlash();
std::shared_ptr<Effect> make_cogging();
std::shared_ptr<Effect> make_constant_load();
std::shared_ptr<Effect> make_coulomb_friction();
std::shared_ptr<Effect> make_cross_saturation();
std::shared_ptr<Effect> make_current_gain();
std::shared_ptr<Effect> make_current_offset();
std::shared_ptr<Effect> make_dc_bus_ripple();
std::shared_ptr<Effect> make_dead_time();
std::shared_ptr<Effect> make_eccentric_load();
std::shared_ptr<Effect> make_encoder_eccentricity();
std::shared_ptr<Effect> make_encoder_offset();
std::shared_ptr<Effect> make_fan_load();
std::shared_ptr<Effect> make_flux_harmonics();
std::shared_ptr<Effect> make_flux_linkage();
std::shared_ptr<Effect> make_friction_ripple();
std::shared_ptr<Effect> make_inductance();
std::shared_ptr<Effect> make_inertia();
std::shared_ptr<Effect> make_inverter_drop();
std::shared_ptr<Effect> make_inverter_offset();
std::shared_ptr<Effect> make_iron_loss();
std::shared_ptr<Effect> make_load_step();
std::shared_ptr<Effect> make_missing_samples();
std::shared_ptr<Effect> make_periodic_torque();
std::shared_ptr<Effect> make_phase_asymmetry();
std::shared_ptr<Effect> make_resistance();
std::shared_ptr<Effect> make_saturation();
std::shared_ptr<Effect> make_signal_lag();
std::shared_ptr<Effect> make_stale_samples();
std::shared_ptr<Effect> make_stribeck_friction();
std::shared_ptr<Effect> make_torsion();
std::shared_ptr<Effect> make_viscous_friction();
std::shared_ptr<Effect> make_voltage_gain();

}  // namespace twinrate
