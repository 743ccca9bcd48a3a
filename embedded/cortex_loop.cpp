#include "embedded/cortex_loop.hpp"

#include <fmt/format.h>

#include <chrono>
#include <fstream>

#include "analysis/summary.hpp"
#include "embedded/closed_run.hpp"

namespace twinrate {
namespace {

constexpr double kDegree = kTwoPi / 360;

void write_row(std::ostream& out, const m3::Answer& a) {
  out << fmt::format("{},{},{},{},{},{},{},{},{},{},{},{},{},{}\n", a.k, a.i_alpha, a.i_beta,
                     a.omega, a.theta, a.gain_snapshot, a.preempted, a.progress, a.late,
                     a.bad_frames, a.clamped_P33, a.clamped_P34, a.clamped_P44, a.clamped_omega);
}

std::uint32_t next_crc(std::uint32_t crc, const m3::Answer& a) {
  std::uint8_t both[4 + sizeof a];
  std::memcpy(both, &crc, 4);
  std::memcpy(both + 4, &a, sizeof a);
  return twp_crc32(both, sizeof both);
}

}  // namespace

CortexRun run_cortex_loop(Config& config, CortexLink link, double period_s,
                          const std::string& log_path) {
  std::ofstream csv;
  if (!log_path.empty()) {
    csv.open(log_path);
    if (!csv) throw BadInput(log_path + ": cannot be written");
    csv << "k,i_alpha,i_beta,omega,theta,gain_snapshot,preempted,progress,late,bad_frames,"
           "clamped_P33,clamped_P34,clamped_P44,clamped_omega\n";
  }
  CortexDevice device(fixed_settings(config), link, period_s);
  Fixed32 host(config);
  CortexRun run;
  const int n_p = config.drive().machine.n_p;
  const auto begin = std::chrono::steady_clock::now();
  const RunLog log = closed_run(config, [&](const Measurement& m) {
    run.last = device.tick(m);
    if (csv.is_open()) write_row(csv, run.last);
    run.log_crc = next_crc(run.log_crc, run.last);
    const FixedEstimate raw = estimate_of(run.last);
    host.tick(m);
    run.equal_ticks += raw == host.raw();
    ++run.ticks;
    return estimate_of(raw, m, n_p);
  });
  const std::chrono::duration<double> wall = std::chrono::steady_clock::now() - begin;
  const Summary summary = summarise(log, config.drive());
  run.locked = summary.locked.value_or(false);
  run.angle_error_rms = summary.angle_error_rms.value_or(0);
  run.ticks_per_s = static_cast<double>(run.ticks) / wall.count();
  const auto settled =
      static_cast<std::size_t>(config.drive().run.settle_s * config.drive().rates.f_s_Hz);
  run.from_double = largest_angle_difference(log.estimate, double_estimates(config, log), settled);
  return run;
}

std::string to_text(const CortexRun& r, const DriveConfig& drive, CortexLink link) {
  return fmt::format(
      "{}: {}  (Cortex-M3 in the loop by {}, {} ticks, n = {}, policy {})\n"
      "  angle error rms         {:.3f} deg\n"
      "  from the double filter  {:.5f} deg at most, from {:.2f} s on\n"
      "  from the host build     {} of {} ticks equal bit for bit\n"
      "  background              interrupted at {} ticks, late {} times\n"
      "  damaged frames          {}\n"
      "  log                     CRC-32 {:08x}\n"
      "  speed of the run        {:.0f} ticks/s\n",
      drive.name, r.locked ? "LOCKED" : "LOST", kCortexLinkNames[static_cast<int>(link)], r.ticks,
      drive.rates.n, kGainPolicyNames[static_cast<int>(drive.gain.policy)],
      r.angle_error_rms / kDegree, r.from_double / kDegree, drive.run.settle_s, r.equal_ticks,
      r.ticks, r.last.preempted, r.last.late, r.last.bad_frames, r.log_crc, r.ticks_per_s);
}

}  // namespace twinrate
