// twinrate-emulator: a simulated drive that speaks a device protocol on a pty or over UDP.
//
//   host -> [line, faults] -> device -> drive -> device -> [line, faults] -> host
//
// The drive starts with the first frame of a host. It keeps its own pace, or waits for each command
// if the host asks for lock-step.
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sys/prctl.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <thread>
#include <utility>

#include "bridge/link.hpp"
#include "core/man_page.hpp"
#include "core/option_values.hpp"
#include "core/process.hpp"
#include "core/report_error.hpp"
#include "emulator/device.hpp"
#include "emulator/fault_options.hpp"
#include "loop/load_drive.hpp"

namespace twinrate {
namespace {

struct EmulatorOptions {
  std::string drive, pty, udp, protocol, log, map;
  std::vector<std::string> faults, overrides;
  bool own_control = false;
  double speed = 1;
  int baud = -1;
  unsigned seed = 1;
};

class Emulator {
 public:
  Emulator(const EmulatorOptions& o, Config& config)
      : options_(o),
        faults_(parse_faults(o.faults)),
        link_(o.pty.empty() ? listen_udp(o.udp) : make_pty(o.pty)),
        drive_(make_drive(o, config)),
        device_(make_device(device_options(config), *drive_, config.drive())),
        up_(faults_.up, o.seed),
        down_(faults_.down, o.seed + 1) {
    const double pace = o.speed * (1 + 1e-6 * faults_.drift_ppm);
    greeted_ = device_->speaks_first();
    tick_ns_ = 1e9 * config.drive().T_s() / pace;
  }

  void run() {
    while (!stop_signalled()) {
      const auto bytes = link_->receive(wait_ms());
      if (!bytes.empty()) hear(bytes);
      const std::int64_t now = now_ns() - begun_ns_;
      while (down_.next_arrival() <= now) {  // in the order of the drive's time
        const std::int64_t arrived = down_.next_arrival();
        if (greeted_) tick_until(arrived - 1);
        if (!std::exchange(greeted_, true)) paced_from_ns_ = arrived;
        device_->take(down_.receive(arrived));
        send(arrived);
      }
      if (greeted_) tick_until(now);
      send(now);
      if (device_->waits() && now_ns() - repeat_from_ns_ > 20'000'000) {
        device_->repeat();
        repeat_from_ns_ = now_ns();
      }
      if (const auto out = up_.receive(now_ns() - begun_ns_); !out.empty()) link_->send(out);
    }
    if (const std::string account = device_->account(); !account.empty())
      fmt::print("twinrate-emulator: {}; line faults made: {} up, {} down\n", account, up_.made(),
                 down_.made());
  }

 private:
  static std::unique_ptr<EmulatedDrive> make_drive(const EmulatorOptions& o, Config& config) {
    if (!o.log.empty()) return std::make_unique<RecordedDrive>(o.log, o.map, config.drive());
    if (o.own_control) return std::make_unique<OwnControlDrive>(config);
    return std::make_unique<PlantDrive>(config);
  }
  DeviceOptions device_options(Config& config) {
    const BridgeParameters bridge = config.read<BridgeParameters>();
    if (options_.baud < 0) options_.baud = options_.pty.empty() ? 0 : bridge.baud;
    faults_.up.baud = faults_.down.baud = options_.baud;
    faults_.up.waits =
        bridge.protocol == DriveProtocol::kVesc;  // a burst is sent as the line takes it
    return {.name = config.drive().name,
            .protocol = bridge.protocol,
            .T_s = config.drive().T_s(),
            .lease_max_s = 1e-3 * bridge.lease_ms,
            .delay = config.drive().plant.delay_samples,
            .moteus_id = bridge.moteus_id,
            .moteus_listen = bridge.moteus_listen,
            .faults = faults_.device};
  }
  // The time of the drive starts when the first frame has arrived.
  void hear(std::span<const std::uint8_t> bytes) {
    if (!std::exchange(heard_, true) && !greeted_) begun_ns_ = now_ns();
    down_.send(bytes, now_ns() - begun_ns_);
  }
  // Time until the next tick or the next arrival on one of the lines.
  double wait_ms() const {
    if (!greeted_ && !heard_) return 50;
    const std::int64_t now = now_ns() - begun_ns_;
    std::int64_t next = std::min(up_.next_arrival(), down_.next_arrival());
    if (greeted_ && !device_->waits()) next = std::min(next, due());
    if (greeted_ && drive_->ended() && next == due()) return 50;
    return 1e-6 * static_cast<double>(std::clamp<std::int64_t>(next - now, 0, 5'000'000));
  }
  std::int64_t due() const {
    return lockstep_ ? 0
                     : std::llround(static_cast<double>(device_->k() - paced_from_k_) * tick_ns_) +
                           paced_from_ns_;
  }
  void tick_until(std::int64_t now) {
    const bool waits = device_->lockstep();
    if (lockstep_ && !waits) {  // a new host can choose another pace
      paced_from_k_ = device_->k();
      paced_from_ns_ = now;
    }
    lockstep_ = waits;
    if (lockstep_) {
      device_->tick();
      if (!device_->waits()) device_->tick();
      return;
    }
    while (!drive_->ended() && due() <= now) {
      const std::int64_t t_ns = due();
      device_->tick();
      send(t_ns);
    }
  }
  void send(std::int64_t t_ns) {
    for (const auto& frame : device_->take_sent())
      up_.send(frame, t_ns), repeat_from_ns_ = now_ns();
  }

  EmulatorOptions options_;
  FaultOptions faults_;
  std::unique_ptr<Link> link_;
  std::unique_ptr<EmulatedDrive> drive_;
  std::unique_ptr<EmulatedDevice> device_;
  FaultyLine up_, down_;
  double tick_ns_ = 0;
  bool heard_ = false, greeted_ = false, lockstep_ = false;
  std::int64_t begun_ns_ = now_ns(), paced_from_k_ = 0, paced_from_ns_ = 0;
  std::int64_t repeat_from_ns_ = now_ns();
};

void add_options(CLI::App& app, EmulatorOptions& o) {
  app.add_option("DRIVE,--config", o.drive, "simulate this drive file or preset")->required();
  app.add_option("--pty", o.pty, "make a pty and this symbolic link to it");
  app.add_option("--udp", o.udp, "receive at HOST:PORT");
  app.add_option("--protocol", o.protocol, "speak this protocol: twinrate, moteus, vesc");
  app.add_option("--fault", o.faults, fault_help())->allow_extra_args(false);
  app.add_flag("--own-control", o.own_control,
               "run the drive's own control, for a host that listens");
  app.add_option("--log", o.log, "send the rows of this drive log (CSV) at their own pace");
  app.add_option("--map", o.map,
                 "read the log through this map (default: the header has canonical names)");
  app.add_option("--speed", o.speed, "run this many times as fast as the drive")
      ->check(CLI::Range(0.01, 1000.0));
  app.add_option("--baud", o.baud,
                 "delay frames by the wire time at this rate, bit/s; 0: none (default: bridge.baud "
                 "on a pty)")
      ->check(CLI::Range(0, 4000000));
  app.add_option("--seed", o.seed, "draw the faults with this seed");
  app.add_option("--set", o.overrides, "override a key of the drive file: key.path=value")
      ->allow_extra_args(false);
}

// Faults of the device itself exist in the twinrate protocol only.
void expect_faults_that_act(const EmulatorOptions& o, Config& config) {
  if (config.read<BridgeParameters>().protocol == DriveProtocol::kTwinrate) return;
  for (const std::string& fault : o.faults)
    if (fault.starts_with("reset_at_s") || fault.starts_with("keeps_last"))
      throw BadInput(
          fmt::format("--fault {}: allowed with bridge.protocol = twinrate alone", fault));
}

int emulate(EmulatorOptions& o) {
  if (o.pty.empty() == o.udp.empty()) throw BadInput("exactly one of --pty and --udp is required");
  if (!o.protocol.empty()) {
    o.overrides.push_back("plant.kind=bridge");
    o.overrides.push_back("bridge.protocol=" + o.protocol);
  }
  Config config = load_drive(o.drive, o.overrides);
  expect_faults_that_act(o, config);
  Emulator emulator(o, config);
  fmt::print("twinrate-emulator: {} on {}\n", config.drive().name, o.pty.empty() ? o.udp : o.pty);
  std::fflush(stdout);
  emulator.run();
  return 0;
}

int parse_and_emulate(int argc, char** argv) {
  CLI::App app{"twinrate-emulator\n  Simulate a drive that speaks a device protocol"};
  EmulatorOptions o;
  add_options(app, o);
  expect_stated_values(app);
  const auto print_man_page = [&] {
    fmt::print("{}", man_page(app, "twinrate-emulator"));
    throw CLI::Success();
  };
  app.add_flag_callback("--man-page", print_man_page, "print the man page")->group("");
  catch_stop_signals();
  prctl(PR_SET_TIMERSLACK, 1);  // ns: the drive answers in time instead of up to 50 us later
  try {
    expect_utf8(argc, argv);
    app.parse(argc, argv);
    return emulate(o);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app.exit(error);
    fmt::print(stderr, "twinrate-emulator: {}\n", printable(error.what()));
    return 2;
  }
}

}  // namespace
}  // namespace twinrate

int main(int argc, char** argv) {
  try {
    return twinrate::parse_and_emulate(argc, argv);
  } catch (...) {
    return twinrate::report_error("twinrate-emulator");
  }
}
