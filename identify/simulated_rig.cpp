#include "identify/simulated_rig.hpp"

#include <fmt/format.h>

#include "identify/experiment.hpp"
#include "loop/load_drive.hpp"

namespace twinrate {
namespace {

Config unloaded(const Config& drive) {
  Config config =
      Config::parse(drive.resolved(), "identify", {"load.T_load_Nm=0.0", "start=aligned"});
  read_all_tables(config);
  return config;
}

Vec2 mirrored(const Vec2& alphabeta) {
  return {alphabeta[0], -alphabeta[1]};
}

}  // namespace

SimulatedRig::SimulatedRig(const Config& drive, const Wiring& wiring)
    : config_(unloaded(drive)), plant_(config_), wiring_(wiring) {
  const DriveConfig& d = config_.drive();
  facts_ = {.T_s = d.T_s(),
            .delay_ticks = d.plant.delay_samples,
            .encoder_counts = d.sensors.encoder_counts,
            .v_dc = d.inverter.v_dc};
}

RigRow SimulatedRig::step(const Vec2& u_alphabeta_ref, double theta_e) {
  Command command;
  command.k = plant_.k();
  const bool swapped = wiring_.swapped_phases;
  command.u_alphabeta_ref = swapped ? mirrored(u_alphabeta_ref) : u_alphabeta_ref;
  command.theta_ctrl = swapped ? -theta_e : theta_e;
  plant_.take_command(command);
  plant_.advance();
  const SafetyMachine& safety = plant_.safety();
  if (safety.is_off() && safety.event_count() > 0)
    throw RunFailed("the drive switched off: " +
                    text_of(safety.event(safety.event_count() - 1), safety));
  const Measurement& m = plant_.sample();
  RigRow row{m.i_abc, m.u_alphabeta, m.theta_m};
  if (swapped) {
    std::swap(row.i_abc[1], row.i_abc[2]);
    row.u_alphabeta = mirrored(row.u_alphabeta);
  }
  if (wiring_.reversed_encoder) row.theta_m = -row.theta_m;
  return row;
}

}  // namespace twinrate
