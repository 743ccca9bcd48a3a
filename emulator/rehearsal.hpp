// Host and device joined by two faulty lines, in simulated time: the bridge's code and the emulated
// device without sockets and clocks. Equal seeds give equal runs.
//
//   device, at t_k of its own clock   SAMPLE(k) -> line up; voltage of [t_k, t_{k+1}]
//   host, when a frame arrives        SAMPLE(k) -> guard, estimator, controller -> COMMAND(k) -> line down
//
// Host time is the time of the simulation; the device's clock is fast by drift_ppm.
#pragma once
#include <memory>
#include <vector>

#include "bridge/guard.hpp"
#include "bridge/twinrate_host.hpp"
#include "controller/controller.hpp"
#include "emulator/faulty_line.hpp"
#include "emulator/twinrate_device.hpp"
#include "loop/estimator_loop.hpp"

namespace twinrate {

struct RehearsalFaults {
  LineFaults up, down;
  DeviceFaults device;
  double drift_ppm = 0;
  double host_ends_at_s = 1e9;       // without a last frame: the process is gone
  double estimator_ends_at_s = 1e9;  // no ESTIMATE, so no COMMAND
  // From then on the host reads phase a with this error, A: a drive that does not check its
  // sensors.
  double misread_from_s = 1e9, misread_A = 0;
};

class Rehearsal {
 public:
  Rehearsal(Config& config, const BridgeParameters& bridge, const RehearsalFaults& faults,
            unsigned seed);

  void run_until(double t_s);
  double t_s() const { return 1e-9 * static_cast<double>(t_ns_); }
  // Restarts the host with a new estimator; `by_hand`: it first clears the drive's reason.
  void restart_host(bool by_hand);

  void emergency_stop() { guard_->emergency_stop(); }

  const PlantDrive& drive() const { return drive_; }
  const TwinrateDevice& device() const { return device_; }
  const TwinrateHost& host() const { return *host_; }
  const BridgeGuard& guard() const { return *guard_; }
  std::int64_t faults_made() const { return up_.made() + down_.made(); }
  std::vector<GuardEvent> events;  // of the guard, all
  // Device time from the arrival of the last enabling command to the first interval without a
  // voltage, s; negative: the outputs are on.
  double off_after_s() const;
  const Estimate& estimate() const { return estimate_; }
  // Ticks of every sample that the host took.
  const std::vector<std::int64_t>& ticks() const { return ticks_; }

 private:
  void device_tick();
  void host_receives(std::int64_t t_ns);
  void answer(DriveSample sample);
  void send(const Bytes& bytes) { down_.send(bytes, t_ns_); }

  Config& config_;
  BridgeParameters bridge_;
  RehearsalFaults faults_;
  PlantDrive drive_;
  TwinrateDevice device_;
  FaultyLine up_, down_;
  std::unique_ptr<TwinrateHost> host_;
  std::unique_ptr<BridgeGuard> guard_;
  std::unique_ptr<EstimatorLoop> estimator_;
  std::unique_ptr<Controller> controller_;
  Estimate estimate_;
  std::vector<std::int64_t> ticks_;
  std::int64_t t_ns_ = 0, last_arrival_ns_ = 0, resets_ = 0, first_k_ = -1;
  double last_command_s_ = -1, off_at_s_ = -1;  // device time
  bool answered_ = false;                       // the previous sample
  Mode mode_ = Mode::kRun;
};

}  // namespace twinrate
