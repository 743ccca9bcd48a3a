// twinrate-monitor: monitors innovations and residuals on the bus, traces and proposes effects.
//
//   MEASUREMENT(k), ESTIMATE(k) -> [LiveMonitor] -> EVENT
//                                                -> REQUEST {add effect} to estimator, gain and
//                                                   controller: monitor.auto_add, or on request
//                                                -> REQUEST {remove effect} to the same, for an
//                                                   effect that makes the error larger
//
// Tracing runs in a separate thread; the loop does not wait for it. RUN_DIR/monitor.json holds the
// results so far. With --follow the monitor restarts with the session or the sequence, as the
// filter does.
#include <fmt/format.h>

#include <filesystem>
#include <fstream>
#include <future>
#include <optional>
#include <set>
#include <stop_token>

#include "core/arbiter.hpp"
#include "core/output_file.hpp"
#include "core/process.hpp"
#include "core/signals_io.hpp"
#include "monitor/live_monitor.hpp"

namespace twinrate {
namespace {

using Clock = std::chrono::steady_clock;

class MonitorProcess {
 public:
  explicit MonitorProcess(Process& p) : p_(p), monitor_(p.config()) {
    p.bus().subscribe<measurement_t>([this](const measurement_t& w) { take(from_wire(w)); });
    p.bus().subscribe<estimate_t>([this](const estimate_t& w) { monitor_.take(from_wire(w)); });
    p.bus().subscribe<reply_t>([this](const reply_t& reply) { take_reply(reply); });
    p.bus().subscribe<event_t>([this](const event_t& event) {
      if (event.reason == static_cast<int>(Reason::kSteered)) monitor_.steer(event.seq, event.text);
    });
    p.bus().on_new_session([this] { restart(); });
    p.on_add_proposed([this](const std::string& text) {
      asker_ = text;
      return monitor_.add_proposed();
    });
    p.waiting_for([this] {
      return Waiting{fmt::format("MEASUREMENT({})", monitor_.last_k() + 1),
                     Patience::kForWholeTicks, Role::kPlant};
    });
  }
  void run() {
    p_.ready();
    write();
    while (p_.turn(5)) look();
    stop_.request_stop();
    write();
  }

 private:
  static constexpr double kRepeat_s = 0.05, kTimeout_s = 3;
  static constexpr std::int64_t kFirstRequest = 1'000'000;  // the supervisor counts from 0

  void take(const Measurement& m) {
    if (m.k < monitor_.last_k() && p_.options().follow) restart();
    monitor_.take(m);
    p_.progress(monitor_.last_k());
  }
  void restart() {
    stop_.request_stop();
    asking_ = false;
    monitor_.restart();
  }
  void look() {
    if (trace_.valid() && trace_.wait_for(std::chrono::seconds(0)) == std::future_status::ready) {
      std::future<TraceResult> done = std::move(trace_);
      if (!stop_.stop_requested()) monitor_.traced(done.get());
    }
    // A stopped trace must end before the next one starts.
    if (!trace_.valid()) begin_trace();
    if (const auto toml = monitor_.take_addition())
      begin_request(RequestKind::kAddEffect, asker_.value_or(own_line()) + *toml);
    if (const auto toml = monitor_.take_removal())
      begin_request(RequestKind::kRemoveEffect, own_line() + *toml);
    if (asking_) repeat_request();
    bool news = false;
    for (const MonitorNotice& notice : monitor_.take_notices()) {
      p_.event(notice.reason, notice.k, notice.text);
      news = true;
    }
    if (news) write();
  }
  void begin_trace() {
    std::optional<TraceJob> job = monitor_.take_job();
    if (!job) return;
    stop_ = {};
    trace_ = std::async(std::launch::async, [job = std::move(*job), stop = stop_.get_token()] {
      return twinrate::run(job, [stop] { return stop.stop_requested(); });
    });
  }
  // Who asks: the drive may have a holder.
  static std::string own_line() {
    return fmt::format("{}{}\n", Arbiter::kHolderLine, Arbiter::kMonitor);
  }
  void begin_request(RequestKind kind, const std::string& toml) {
    asker_.reset();
    request_ = {};
    request_.seq = kFirstRequest + requests_++;
    request_.kind = static_cast<std::int32_t>(kind);
    request_.value = static_cast<double>(monitor_.tick_for_request());
    request_.text = toml;
    answered_.clear();
    applied_ = -1;
    asking_ = true;
    asked_at_ = sent_at_ = Clock::now();
    p_.bus().publish(request_);
  }
  void repeat_request() {
    const auto now = Clock::now();
    const auto since = [now](Clock::time_point then) {
      return std::chrono::duration<double>(now - then).count();
    };
    // A replay has no controller: the answer of the estimator is enough.
    const bool complete = answered_.size() >= 3;
    if (complete || since(asked_at_) > kTimeout_s) {
      asking_ = false;
      const bool adding = request_.kind == static_cast<std::int32_t>(RequestKind::kAddEffect);
      if (applied_ < 0)
        monitor_.refused("no estimator answered");
      else if (adding)
        monitor_.added(applied_);
      else
        monitor_.removed(applied_);
      return;
    }
    if (since(sent_at_) < kRepeat_s) return;
    sent_at_ = now;
    p_.bus().publish(request_);
  }
  void take_reply(const reply_t& reply) {
    if (!asking_ || reply.seq != request_.seq) return;
    if (!reply.accepted) {
      asking_ = false;
      monitor_.refused(fmt::format("{}: {}", role_name(reply.role), reply.text));
      return;
    }
    if (reply.applied_seq < 0) return;  // it agreed, the tick comes later
    answered_.insert(reply.role);
    applied_ = std::max(applied_, reply.applied_seq);
  }
  void write() {
    const std::filesystem::path directory =
        p_.options().run_dir.empty() ? "." : p_.options().run_dir;
    const std::filesystem::path path = directory / "monitor.json";
    if (!std::exchange(made_file_, true)) create_new(path.string());
    std::ofstream file(path);
    file << monitor_.to_json();
    if (file.flush() || p_.exit_code() != 0) return;
    p_.fail(Reason::kDiskFull, monitor_.last_k(), path.string() + ": cannot be written");
  }

  Process& p_;
  LiveMonitor monitor_;
  bool made_file_ = false;  // monitor.json
  std::future<TraceResult> trace_;
  std::stop_source stop_;  // of the running trace
  bool asking_ = false;
  std::optional<std::string> asker_;  // text of the request for the addition
  request_t request_{};
  std::int64_t requests_ = 0, applied_ = -1;
  std::set<int> answered_;
  Clock::time_point asked_at_, sent_at_;
};

}  // namespace
}  // namespace twinrate

int main(int argc, char** argv) {
  using namespace twinrate;
  return run_process({Role::kMonitor, "twinrate-monitor",
                      "MEASUREMENT, ESTIMATE -> misfit, traced effect -> EVENT, REQUEST"},
                     argc, argv, [](Process& p) { MonitorProcess(p).run(); });
}
