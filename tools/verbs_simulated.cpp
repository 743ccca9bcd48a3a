// The verbs that run a simulated drive and show the run (TWINRATE_VERBS=SIMULATED, which tools/demo
// builds). --help lists the others too, each with the command that builds it.
#include "tools/run_verb.hpp"
#include "tools/verb.hpp"

namespace twinrate {
namespace {

void add_verbs(CLI::App& app, int& exit_code) {
  add_launch_verb(app, exit_code);
  add_absent_verb(app, "bridge", "Probe, shadow or drive a real drive on its line");
  add_absent_verb(app, "machine", "Write the drive file of a motor; list the presets");
  add_absent_verb(app, "monitor", "Add effects to the model of a running drive, or remove them");
  add_absent_verb(app, "new", "Write the folder of an own process of the loop");
  add_simulate_verb(app, exit_code, nullptr);
  add_check_verb(app, exit_code);
  add_replay_verb(app, exit_code);
  add_absent_verb(app, "identify", "Identify an unknown motor: experiments to a drive file");
  add_absent_verb(app, "import", "Convert a measured file into an LCM log");
  add_absent_verb(app, "export", "Write a log as a CSV, MATLAB or MCAP file");
  add_report_verb(app, exit_code);
  add_absent_verb(app, "figures", "Write the figures of a report, trace or sweep as SVG or PDF");
  add_absent_verb(app, "response",
                  "Measure the frequency response of a closed loop beside its design");
  add_absent_verb(app, "spy", "Start lcm-spy with the message types of the drive");
  add_set_verb(app, exit_code);
  add_watch_verb(app, exit_code);
  add_absent_verb(app, "scope",
                  "Show a running drive, or a run, on a page: curves, trigger, spectra, events");
  add_absent_verb(app, "stream", "Show a running drive in PlotJuggler or Foxglove");
  add_doctor_verb(app, exit_code);
  add_absent_verb(app, "design", "Design a controller for a drive");
  add_absent_verb(app, "effects", "List the effects that a drive file can add to the equations");
  add_absent_verb(app, "sweep", "Find the slowest gain update rate f_bmin that keeps synchronism");
  add_absent_verb(
      app, "trace",
      "Find the effects that a model lacks, from a recorded drive; write the extended model");
  add_absent_verb(app, "tune", "Find the noise weights of the filter from a recorded drive");
}

}  // namespace

int run_simulated_verb(int argc, const char* const* argv) {
  return run_verb_of(add_verbs, argc, argv);
}

}  // namespace twinrate
