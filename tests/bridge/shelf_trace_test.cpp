// A hidden effect in the emulated drive behind a protocol of the shelf: heard, logged, traced.
#include <gtest/gtest.h>

#include <deque>
#include <filesystem>
#include <random>

#include "bridge/moteus_host.hpp"
#include "bridge/vesc_host.hpp"
#include "core/manifest.hpp"
#include "core/signals_io.hpp"
#include "drive_log/trace_drive_logs.hpp"
#include "emulator/moteus_device.hpp"
#include "emulator/vesc_device.hpp"
#include "import/whole_log.hpp"
#include "loop/load_drive.hpp"

namespace twinrate::shelf_trace_test {
namespace {

using Overrides = std::vector<std::string>;

// Speed steps, so that inertia, friction and cogging can be told apart; the load is not declared.
const Overrides kDrive = {"controller.kind=foc",
                          "controller.angle_source=measured",
                          "controller.foc.speed_bandwidth_Hz=15",
                          "controller.compensation=off",
                          "effect=[]",
                          ("reference.speed_rpm=[[0,150],[0.5,250],[1,200],[1.5,300],[2,120],[2.5,"
                           "250],[3,200],[3.5,300],[4,150],[4.5,250],[5,200],[5.5,300]]"),
                          "reference.slew_rad_s2=300"};

Overrides with(Overrides more) {
  more.insert(more.begin(), kDrive.begin(), kDrive.end());
  return more;
}

// Polled at once or when the host wants: a question takes 0.23 ms to the drive and its answer 0.49 ms
// back, as over a line of 3 Mbaud, each longer by up to `late_ns`, most by little.
template <class Device, class Host>
std::vector<Measurement> listen(const Overrides& device_drive, Config& host_config, double t_s,
                                double late_ns) {
  constexpr std::int64_t kThere_ns = 230'000, kBack_ns = 490'000, kHost_ns = 20'000,
                         kTurn_ns = 100'000;
  Config config = load_drive("niewiara2020", with(device_drive));
  OwnControlDrive own(config);
  const DriveConfig& d = config.drive();
  Device device = [&]() -> Device {
    if constexpr (std::is_same_v<Device, MoteusBurstDevice>)
      return Device(own, d.machine);
    else
      return Device({.T_s = d.T_s()}, own, d.machine);
  }();
  Host host(host_config.read<BridgeParameters>(), host_config.drive());
  std::mt19937 random(1);
  const auto late = [&] {
    const double share = std::uniform_real_distribution<>(0, 1)(random);
    return static_cast<std::int64_t>(late_ns * share * share * share * share);
  };
  std::deque<std::pair<std::int64_t, Bytes>> to_device, to_host;
  const auto ask = [&](const Bytes& question, std::int64_t t_ns) {
    if (question.empty()) return;
    host.asked(t_ns);
    to_device.emplace_back(t_ns + kThere_ns + late(), question);
  };
  ask(host.hello(false), 0);
  std::vector<Measurement> heard;
  const auto ticks = static_cast<std::int64_t>(t_s / d.T_s());
  std::int64_t host_ns = 0;
  double first_us = 0;
  for (std::int64_t k = 0; k < ticks; ++k) {
    const std::int64_t now_ns = d.t_ns(k), next_ns = d.t_ns(k + 1);
    for (; !to_device.empty() && to_device.front().first < next_ns; to_device.pop_front())
      device.take(to_device.front().second);
    device.tick();
    for (const Bytes& frame : device.take_sent())
      to_host.emplace_back(now_ns + kBack_ns + late(), frame);
    for (; host_ns < next_ns;
         host_ns += kHost_ns + std::uniform_int_distribution<std::int64_t>(0, kTurn_ns)(random)) {
      for (; !to_host.empty() && to_host.front().first <= host_ns; to_host.pop_front())
        host.take(to_host.front().second, to_host.front().first);
      ask(host.poll(host_ns), host_ns);
      while (const auto sample = host.next()) {
        if (heard.empty()) first_us = sample->sampled_us.value_or(0);
        heard.push_back(sample->m);
        heard.back().k -= heard.front().k;
        heard.back().t_ns = sample->sampled_us
                                ? std::llround(1e3 * (*sample->sampled_us - first_us))
                                : host_config.drive().t_ns(heard.back().k);
      }
    }
  }
  heard.front().k = 0;
  return heard;
}

TraceResult trace(const std::vector<Measurement>& heard, const Config& host) {
  const std::string path = (std::filesystem::temp_directory_path() /
                            ("shelf-trace-" + std::to_string(getpid()) + ".lcm"))
                               .string();
  WholeLog log(path);
  log.write(make_manifest(1, host.resolved(), "{}"), 1'000'000);
  for (const Measurement& m : heard) log.write(to_wire(m, 1), 1'000'000 + m.t_ns / 1000);
  log.finish();
  const DriveLogs logs = read_drive_logs({.data = {path}}, host.drive());
  std::filesystem::remove(path);
  return trace_drive_logs(logs, held_out_rows(logs, 0.25, host.drive().machine.n_p), host.drive(),
                          {});
}

const TracedEffect* effect(const TraceResult& r, std::string_view kind) {
  for (const TracedEffect& e : r.effects)
    if (e.effect->kind() == kind) return &e;
  return nullptr;
}

// Within four sigma of the truth, and within `share` of it.
void expect_parameter(const TraceResult& r, std::string_view kind, const std::string& name,
                      double truth, double share) {
  const TracedEffect* found = effect(r, kind);
  ASSERT_NE(found, nullptr) << kind << ": " << r.sentence;
  for (const TracedParameter& p : found->parameters) {
    if (p.name != name) continue;
    ASSERT_TRUE(p.sigma);
    EXPECT_LT(std::abs(p.value - truth), 4 * *p.sigma) << kind << " " << name;
    EXPECT_LT(std::abs(p.value - truth), share * truth) << kind << " " << name;
    return;
  }
  ADD_FAILURE() << kind << " has no " << name;
}

const char* const kCogging = "effect=[{kind=\"cogging\",order=24,amplitude_Nm=0.4,phase_rad=0.7}]";

const char* const kBothWays =
    "reference.speed_rpm=[[0,150],[1,250],[2,-200],[3,-300],[4,120],[5,250],[6,-150],[7,-250]]";

// Polled once a millisecond, at uneven moments that the host knows from its round trips: within 10 us
// rms, most of it the control period of the drive. At 300 rpm that is noise of 5 Nm.
TEST(Heard, ThroughMoteusRegistersPolledUnevenlyACoggingIsNamed) {
  Config host =
      load_drive("niewiara2020", with({kBothWays, "rates.f_s_Hz=1000", "plant.kind=bridge",
                                       "bridge.protocol=moteus", "bridge.mode=listen"}));
  const TraceResult r = trace(
      listen<MoteusDevice, MoteusHost>({kBothWays, kCogging, "rates.f_s_Hz=30000"}, host, 6, 50e3),
      host);
  EXPECT_EQ(r.verdict, "traced") << r.sentence;
  for (const TracedEffect& e : r.effects)
    EXPECT_TRUE(e.effect->kind() == "cogging" || e.effect->kind() == "missing_samples")
        << e.effect->kind() << ": " << r.sentence;
  expect_parameter(r, "cogging", "amplitude", 0.4, 0.05);
  expect_parameter(r, "cogging", "phase", 0.7, 0.05);
}

// Angle and currents alone, the angle in 2^16 steps, the currents cut towards zero.
TEST(Heard, ThroughTheDebugUartCoggingAloneIsTraced) {
  Config host =
      load_drive("niewiara2020", with({"plant.kind=bridge", "bridge.protocol=moteus",
                                       "bridge.moteus_listen=uart", "bridge.mode=listen"}));
  const TraceResult r =
      trace(listen<MoteusBurstDevice, MoteusBurst>({kCogging}, host, 10, 0), host);
  EXPECT_EQ(r.verdict, "traced") << r.sentence;
  EXPECT_EQ(r.effects.size(), 1u) << r.sentence;
  expect_parameter(r, "cogging", "amplitude", 0.4, 0.02);
}

// Bursts, the angle in steps of 1.44 electrical degrees.
TEST(Heard, ThroughVescBurstsDeadTimeAndALargeCoggingAreNamed) {
  Config host = load_drive("niewiara2020", with({kBothWays, "plant.kind=bridge",
                                                 "bridge.protocol=vesc", "bridge.mode=listen"}));
  const TraceResult r = trace(
      listen<VescDevice, VescHost>({kBothWays,
                                    "effect=[{kind=\"dead_time\",dead_time_s=2e-6},"
                                    "{kind=\"cogging\",order=6,amplitude_Nm=0.4,phase_rad=0.7}]"},
                                   host, 8, 0),
      host);
  for (const TracedEffect& e : r.effects)
    EXPECT_TRUE(e.effect->kind() == std::string("dead_time") ||
                e.effect->kind() == std::string("cogging") ||
                e.effect->kind() == std::string("missing_samples"))
        << e.effect->kind() << ": " << r.sentence;
  expect_parameter(r, "dead_time", "dead_time", 2e-6, 0.02);
  expect_parameter(r, "cogging", "amplitude", 0.4, 0.05);
}

}  // namespace
}  // namespace twinrate::shelf_trace_test
