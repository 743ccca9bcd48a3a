#include "tests/support/option_situations.hpp"

#include <algorithm>

namespace twinrate::test {

Overrides joined(const Overrides& list, const Overrides& more) {
  const auto key_of = [](const std::string& text) { return text.substr(0, text.find('=')); };
  Overrides all;
  for (const std::string& one : list)
    if (std::none_of(more.begin(), more.end(),
                     [&](const std::string& m) { return key_of(m) == key_of(one); }))
      all.push_back(one);
  all.insert(all.end(), more.begin(), more.end());
  return all;
}

namespace {

// The low-pass of the speed cannot follow, so that its limit of the angle's change is too small.
Overrides sudden_speed(const std::string& filter) {
  const std::string table = "estimator." + filter + ".";
  return {table + "speed_from=emf", table + "lowpass_Hz=0.1", table + "limit_floor_rad=0",
          "reference.slew_rad_s2=0", "reference.speed_rpm=[[0.0,120.0],[0.05,600.0]]"};
}

}  // namespace

const std::vector<Situation>& situations() {
  static const Overrides jump{"plant.fault.kind=current_jump", "plant.fault.at_s=0.02",
                              "plant.fault.value=0.5", "plant.fault.for_s=0.01"};
  static const Overrides missing{"plant.fault.kind=command_missing", "plant.fault.at_s=0.02"};
  static const Overrides bus_high{"plant.fault.kind=bus_voltage", "plant.fault.at_s=0.02",
                                  "plant.fault.value=1000"};
  static const Overrides two_speeds{"reference.speed_rpm=[[0.0,1800.0],[0.05,2000.0]]"};
  // More torque than the current limit has, from 0.2 s on: the rotor stalls and turns back, faster than
  // over-speed allows.
  static const Overrides stall{"CONTROLLER.synchronism.watch=true", "load.slew_Nm_s=0",
                               "load.T_load_Nm=[[0.0,0.12T],[0.2,12T],[0.22,0.12T]]",
                               "safety.omega_m_max_rad_s=1e5", "machine.i_trip_A=1000"};
  static const Overrides stall_by_innovation = joined(
      stall, {"CONTROLLER.synchronism.emf_limit=10", "CONTROLLER.synchronism.innovation_A=1e-3"});
  static const Overrides stall_by_emf = joined(stall, {"CONTROLLER.synchronism.nis_limit=1e6"});
  static const Overrides stall_alone(stall.begin() + 1, stall.end());
  static const Overrides unwatched = joined(stall, {"CONTROLLER.synchronism.watch=false"});
  static const Overrides stop =
      joined(stall, {"CONTROLLER.synchronism.reaction=stop", "CONTROLLER.startup.t_align_s=0.03",
                     "CONTROLLER.startup.acceleration_rad_s2=4000.0"});
  static const Overrides hot{"machine.i_rated_A=1I", "safety.temperature_max_degC=26",
                             "plant.winding.ambient_degC=25", "plant.winding.tau_s=0.01"};
  // Two blocks of 0.1 s or more at a constant speed, by a measured angle.
  static const Overrides learning{"controller.compensation=angle_domain",
                                  "controller.angle_source=measured", "run.duration_s=1",
                                  "start=flying", "reference.speed_rpm=600.0"};
  static const Overrides fast_learning = joined(learning, {"reference.speed_rpm=3000.0"});
  // The watch is as sensitive as it can be, and a current sensor jumps.
  static const Overrides jump_by_emf{"CONTROLLER.synchronism.watch=true",
                                     "CONTROLLER.synchronism.emf_limit=0.05",
                                     "CONTROLLER.synchronism.t_lost_s=0",
                                     "CONTROLLER.synchronism.t_find_s=0",
                                     "CONTROLLER.synchronism.lowpass_Hz=500",
                                     "machine.i_trip_A=1e5",
                                     "safety.omega_m_max_rad_s=1e5",
                                     "safety.watch_sensors=false",
                                     "plant.fault.kind=current_jump",
                                     "plant.fault.value=4I",
                                     "plant.fault.at_s=0.1"};
  static const Overrides jump_by_innovation =
      joined(jump_by_emf, {"CONTROLLER.synchronism.emf_limit=10",
                           "CONTROLLER.synchronism.innovation_A=1e-3", "plant.fault.value=20I"});
  static const Overrides small_jump_by_innovation =
      joined(jump_by_innovation, {"plant.fault.value=4I"});
  // Noise far above innovation_A: only nis_limit decides whether the estimate has agreed once.
  static const Overrides jump_if_found =
      joined(jump_by_emf, {"CONTROLLER.synchronism.emf_limit=0.6", "plant.fault.value=20I",
                           "CONTROLLER.synchronism.innovation_A=1e-3",
                           "CONTROLLER.synchronism.t_find_s=100", "sensors.i_noise_rms_A=0.01I"});
  static const Overrides jump_alone{"machine.i_trip_A=1e5",       "safety.omega_m_max_rad_s=1e5",
                                    "safety.watch_sensors=false", "plant.fault.kind=current_jump",
                                    "plant.fault.value=20I",      "plant.fault.at_s=0.1"};
  static const Overrides jump_when_found =
      joined(jump_by_emf, {"CONTROLLER.synchronism.emf_limit=0.6", "plant.fault.value=20I",
                           "CONTROLLER.synchronism.innovation_A=100"});
  static const Overrides jump_and_stop =
      joined(jump_by_emf, {"CONTROLLER.synchronism.reaction=stop"});
  static const Overrides hard_stall =
      joined(unwatched, {"load.T_load_Nm=[[0.0,0.12T],[0.1,200T],[0.15,0.12T]]"});
  static const Overrides fast{"reference.speed_rpm=6000.0", "reference.slew_rad_s2=0"};
  static const Overrides weakened = joined(fast, {"CONTROLLER.field_weakening=true"});
  // On a drive whose reference is slow.
  static const Overrides at_speed{"reference.speed_rpm=0.3N", "reference.slew_rad_s2=0"};
  static const Overrides jump_by_emf_at_speed = joined(jump_by_emf, at_speed);
  static const Overrides jump_by_innovation_at_speed = joined(jump_by_innovation, at_speed);
  static const Overrides jump_if_found_at_speed = joined(jump_if_found, at_speed);
  static const Overrides stall_at_speed = joined(stall, at_speed);
  // A hand-over on a heavy rotor.
  static const Overrides slow_start{"run.duration_s=1",
                                    "CONTROLLER.startup.t_align_s=0.2",
                                    "CONTROLLER.startup.acceleration_rad_s2=500",
                                    "CONTROLLER.startup.omega_e_handover_rad_s=100",
                                    "sensors.i_noise_rms_A=0.01I",
                                    "reference.speed_rpm=0.3N"};
  static const std::vector<Situation> all = {
      {"plant.fault.", jump},
      {"plant.hold_ticks", missing},
      {"safety.hold_ms", missing},
      {"safety.off", missing},
      {"safety.off_at.over_current",
       {"plant.fault.kind=current_jump", "plant.fault.at_s=0.02", "plant.fault.value=50I",
        "safety.watch_sensors=false"}},
      {"safety.off_at.over_voltage", bus_high},
      {"safety.off_at.under_voltage",
       {"plant.fault.kind=bus_voltage", "plant.fault.at_s=0.02", "plant.fault.value=1"}},
      {"safety.off_at.over_speed", {"safety.omega_m_max_rad_s=3"}},
      {"safety.off_at.over_temperature",
       {"safety.temperature_max_degC=30", "plant.fault.kind=temperature", "plant.fault.at_s=0.02",
        "plant.fault.value=100"}},
      {"safety.off_at.sensor_lost", {"plant.fault.kind=current_nan", "plant.fault.at_s=0.02"}},
      {"safety.off_at.command_not_finite",
       {"plant.fault.kind=command_nan", "plant.fault.at_s=0.02"}},
      {"safety.off_at.command_lost", missing},
      {"safety.watch_sensors", {"plant.fault.kind=current_nan", "plant.fault.at_s=0.02"}},
      {"safety.sensor_ticks", {"plant.fault.kind=current_nan", "plant.fault.at_s=0.02"}},
      {"safety.temperature_derate_degC", hot},
      {"safety.temperature_derate_degC",
       {"safety.temperature_max_degC=200", "plant.winding.tau_s=0.01"}},
      {"plant.winding.", hot},
      {"plant.erk_steps", {"plant.engine=erk"}},
      {"plant.erk_steps", {"plant.engine=erk", "plant.erk_steps=4"}},  // where 1 is too few
      {"inverter.f_pwm_Hz", {"plant.inverter=switched"}},
      {"rates.n_from", {"rates.n_from=start", "rates.n_from_s=0.1"}},
      {"rates.n_from_s", {"rates.n_from=start"}},
      {"steering.n", {"rates.n_from=start"}},
      {"steering.policy", {"rates.n_from=start"}},
      {"gain.speed_span_rad_s", {"gain.policy=propagated"}},
      {"reference.slew_rad_s2", two_speeds},
      {"load.slew_Nm_s", {"load.T_load_Nm=0.1T"}},
      {"estimator.active_flux.limit", unwatched},
      {"estimator.active_flux.limit_floor_rad", unwatched},
      {"estimator.eemf.rotation", {"estimator.prediction=euler"}},
      {"estimator.ekf_joint.Q_order_Nm2", {"estimator.ekf_joint.order=6"}},
      {"estimator.ekf_joint.P0_order_Nm2", {"estimator.ekf_joint.order=6"}},
      {"CONTROLLER.compensate_effects",
       {"effect=[{kind=\"dead_time\",used_in=\"both\",dead_time_s=1e-6}]"}},
      {"CONTROLLER.synchronism.watch", unwatched},
      {"CONTROLLER.synchronism.", stall},
      {"CONTROLLER.synchronism.", stall_by_innovation},
      {"CONTROLLER.synchronism.", stall_by_emf},
      {"CONTROLLER.synchronism.", stop},
      {"CONTROLLER.startup.", stop},
      {"CONTROLLER.k_awu_rad_s", stall_alone},
      {"CONTROLLER.current_angle", {"machine.L_d_H=1e-3", "machine.L_q_H=2e-3"}},
      {"CONTROLLER.startup.t_give_up_s", {"CONTROLLER.startup.t_agree_s=0.05"}},
      {"CONTROLLER.K_d", {"CONTROLLER.gains=given"}},
      {"CONTROLLER.K_q", {"CONTROLLER.gains=given"}},
      {"CONTROLLER.Q_d", {"CONTROLLER.gains=weights"}},
      {"CONTROLLER.R_d", {"CONTROLLER.gains=weights"}},
      {"CONTROLLER.Q_q", {"CONTROLLER.gains=weights"}},
      {"CONTROLLER.R_q", {"CONTROLLER.gains=weights"}},
      {"CONTROLLER.deviation_d", {"CONTROLLER.gains=deviations"}},
      {"CONTROLLER.deviation_q", {"CONTROLLER.gains=deviations"}},
      {"CONTROLLER.bandwidth_d_Hz", {"CONTROLLER.gains=bandwidths"}},
      {"CONTROLLER.bandwidth_q_Hz", {"CONTROLLER.gains=bandwidths"}},
      {"CONTROLLER.voltage_margin",
       {"CONTROLLER.field_weakening=true", "reference.speed_rpm=6000.0"}},
      {"CONTROLLER.field_weakening_bandwidth_Hz",
       {"CONTROLLER.field_weakening=true", "reference.speed_rpm=6000.0"}},
      {"CONTROLLER.field_weakening", {"reference.speed_rpm=6000.0"}},
      {"CONTROLLER.synchronism.watch", jump_alone},
      {"CONTROLLER.synchronism.nis_limit", small_jump_by_innovation},
      {"CONTROLLER.synchronism.nis_limit", jump_if_found},
      {"CONTROLLER.synchronism.", jump_by_emf},
      {"CONTROLLER.synchronism.", jump_by_innovation},
      {"CONTROLLER.synchronism.", jump_when_found},
      {"CONTROLLER.synchronism.", jump_and_stop},
      {"CONTROLLER.startup.", jump_and_stop},
      {"CONTROLLER.startup.t_fade_s", {"CONTROLLER.current_angle=mtpa", "machine.L_q_H=1.5L"}},
      {"CONTROLLER.k_awu_rad_s", fast},
      {"CONTROLLER.voltage_margin", weakened},
      {"CONTROLLER.field_weakening_bandwidth_Hz", weakened},
      {"CONTROLLER.field_weakening", fast},
      {"CONTROLLER.startup.t_fade_s", {"sensors.i_noise_rms_A=0.01I"}},
      {"run.seed", {"sensors.i_noise_rms_A=0.01I"}},
      {"machine.i_rated_A",
       {"plant.fault.kind=current_jump", "plant.fault.at_s=0.02", "plant.fault.value=100.0",
        "safety.watch_sensors=false"}},
      {"estimator.ekf_disturbance.speed_from_angle", {"sensors.encoder_counts=0"}},
      {"estimator.backemf_printed.saliency_in_speed", {"machine.L_q_H=1.5L"}},
      {"estimator.active_flux.saliency_in_speed",
       {"estimator.active_flux.speed_from=emf", "machine.L_q_H=1.5L"}},
      {"estimator.active_flux.limit", hard_stall},
      {"estimator.active_flux.limit_floor_rad", hard_stall},
      {"estimator.backemf_printed.limit", unwatched},
      {"estimator.backemf_printed.limit_floor_rad", unwatched},
      {"estimator.backemf_printed.limit", hard_stall},
      {"estimator.backemf_printed.limit_floor_rad", hard_stall},
      {"estimator.active_flux.limit", sudden_speed("active_flux")},
      {"estimator.active_flux.limit_floor_rad", sudden_speed("active_flux")},
      {"estimator.backemf_printed.limit", sudden_speed("backemf_printed")},
      {"estimator.backemf_printed.limit_floor_rad", sudden_speed("backemf_printed")},
      {"CONTROLLER.angle_domain.", learning},
      {"CONTROLLER.angle_domain.", fast_learning},
      {"CONTROLLER.synchronism.", jump_by_emf_at_speed, true},
      {"CONTROLLER.synchronism.", jump_by_innovation_at_speed, true},
      {"CONTROLLER.synchronism.", jump_if_found_at_speed, true},
      {"CONTROLLER.synchronism.", stall_at_speed, true},
      {"CONTROLLER.synchronism.watch", joined(unwatched, at_speed), true},
      {"CONTROLLER.synchronism.watch",
       joined(joined(jump_alone, at_speed),
              {"CONTROLLER.synchronism.watch=false", "plant.fault.value=100I"}),
       true},
      // The rotor is driven through standstill and back.
      {"CONTROLLER.synchronism.watch", joined(joined(hard_stall, at_speed), {"run.duration_s=1"}),
       true},
      {"reference.slew_rad_s2", {"reference.speed_rpm=[[0.0,0.3N],[0.05,0.4N]]"}, true},
      {"safety.off_at.over_speed",
       {"safety.omega_m_max_rad_s=3", "reference.speed_rpm=0.3N"},
       true},
      // Before an over-current does it.
      {"safety.off_at.command_lost", joined(missing, {"machine.i_trip_A=1e5"}), true},
      {"safety.off", joined(missing, {"machine.i_trip_A=1e5"}), true},
      {"CONTROLLER.startup.t_align_s",
       joined(joined(jump_and_stop, at_speed), {"run.duration_s=1"}), true},
      {"CONTROLLER.startup.t_align_s",
       joined(joined(jump_by_innovation, at_speed),
              {"run.duration_s=1", "CONTROLLER.synchronism.reaction=stop"}),
       true},
      // An innovation between the limits.
      {"CONTROLLER.synchronism.nis_limit",
       joined(jump_by_innovation_at_speed, {"CONTROLLER.synchronism.innovation_A=1I"}), true},
      {"CONTROLLER.field_weakening",
       {"reference.speed_rpm=1.3N", "CONTROLLER.field_weakening=false"},
       true},
      {"CONTROLLER.field_weakening_bandwidth_Hz",
       {"reference.speed_rpm=1.3N", "CONTROLLER.field_weakening=true"},
       true},
      {"CONTROLLER.current_angle", {"machine.L_q_H=1.5L"}, true},
      {"CONTROLLER.current_angle", {"machine.L_q_H=1.5L", "CONTROLLER.gains=bandwidths"}, true},
      {"CONTROLLER.startup.t_fade_s", slow_start, true},
      {"CONTROLLER.startup.t_fade_s",
       joined(slow_start, {"CONTROLLER.current_angle=mtpa", "machine.L_q_H=1.5L"}), true},
      {"plant.winding.", joined(hot, {"run.duration_s=1", "load.T_load_Nm=1T"}), true}};
  return all;
}

const std::vector<std::pair<std::string, std::string>>& acts_elsewhere() {
  static const std::vector<std::pair<std::string, std::string>> all = {
      {"machine.n_slots", "report: sources of an order"},
      {"controller.compensation", "off where the filter and controller have none anyway"},
      {"machine.T_rated_Nm", "sweep --load, report"},
      {"machine.omega_m_rated_rad_s", "limits of steering and over-speed"},
      {"plant.kind", "launch, bridge; simulate refuses it"},
      {"reference.from_bus", "launch"},
      {"run.settle_s", "figures of the summary"},
      {"run.duration_s", "length of the run"},
      {"gain.max_age_ticks", "launch --pace realtime"},
      {"safety.supervisor_ms", "launch --pace realtime"},
      {"safety.off_at.emergency_stop", "set emergency_stop"},
      {"safety.off_at.safe_requested", "safe mode asked for"},
      {"safety.off_at.supervisor_lost", "launch --pace realtime"},
      {"steering.hold_s", "launch, steered"},
      {"steering.ramp_rad_s2", "launch, steered"},
      {"steering.load_max_Nm", "launch, steered"},
      {"bus.", "launch"},
      {"logger.", "launch"},
      {"realtime.", "launch --pace realtime"},
      {"monitor.", "launch, twinrate-monitor"}};
  return all;
}

}  // namespace twinrate::test
