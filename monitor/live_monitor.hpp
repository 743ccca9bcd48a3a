// Monitors a running drive and reports effects missing in its model. Pure: messages in, notices and
// requests out. twinrate-monitor connects it to the bus, `twinrate simulate` to its own loop.
//
//   learning -> watching -> (two consecutive misfit blocks) gathering -> tracing -> proposed
//            -> adding -> comparing -> watching ..
//   an added effect that is worse than none -> removing -> learning ..
//
// Traced data: gather_s from the first misfit block on; without a result twice as much, up to
// window_s. The effects are fitted to and chosen on the first two thirds of them; the gate
// (trace/gate.hpp) judges on the last third, rows after the fit window that nothing else has read.
// Only effects that pass are proposed. Without a result for window_s the monitor reports it and
// learns the present data as normal. If the extended model fits only a part of the data, or leaves
// a part unexplained, another effect may have started meanwhile: gathering restarts, up to
// kMaxRestarts times, so that all effects act during the whole data. If a part still stays
// unexplained beside an effect, the effect is reported and not proposed: it may be a part of
// another effect. After an addition the residual of the following data is computed with and without
// the effect, and the filter's innovations before and after are compared. From then on every block
// judges the added effects (monitor/added_effects.hpp). An effect that makes the error larger is
// removed. All effects of an addition are removed if every block's innovation after it is kMargin
// (in power) above every block's innovation before it.
#pragma once
#include <functional>
#include <optional>
#include <string_view>

#include "core/config.hpp"
#include "core/reason.hpp"
#include "monitor/added_effects.hpp"
#include "monitor/misfit_watch.hpp"
#include "monitor/monitor_parameters.hpp"
#include "trace/result.hpp"

namespace twinrate {

struct MonitorNotice {
  Reason reason = Reason::kNone;
  std::int64_t k = -1;
  std::string text;
};

// One misfit, from its detection to the comparison.
struct Episode {
  // Drive time; 0: not yet.
  double noticed_s = 0, proposed_s = 0, added_s = 0, compared_s = 0, taken_back_s = 0;
  double traced_s = 0;  // length of the traced data
  std::string sign, verdict, sentence, toml;
  std::string taken_back;  // why, one line for each effect that was
  std::vector<std::string> kinds;
  ResidualRms before, after;                                // without and with it, after addition
  std::vector<double> innovation_before, innovation_after;  // rms of each output
};

struct TraceJob {
  Record record;
  Health health;
  DriveConfig drive;          // with the effects added so far
  std::vector<char> judging;  // of each row of the record: the last third
};
// Traces a job; takes about a second. Thread-safe. `stop` as in TraceSettings. Names no effect if
// too few rows are left to judge it.
TraceResult run(const TraceJob& job, std::function<bool()> stop = {});

class LiveMonitor {
 public:
  // Throws BadInput if the values of monitor.* contradict each other.
  explicit LiveMonitor(Config& config);

  // Restarts for another run of the drive. Keeps only the added effects, as the processes do.
  void restart();

  // To be called in this order each tick. An estimate without its measurement is ignored.
  void take(const Measurement& m);
  void take(const Estimate& e);
  // A request that holds from tick k on (core/steering.hpp): its load is no misfit.
  void steer(std::int64_t k, std::string_view lines) { load_.steer(k, lines); }

  std::vector<MonitorNotice> take_notices();
  // Data to be traced, once. Pass the result to traced().
  std::optional<TraceJob> take_job();
  void traced(const TraceResult& result);
  // [[effect]] tables to be added to the running processes, once: by monitor.auto_add or after
  // add_proposed(). Pass the answer to added() or refused().
  std::optional<std::string> take_addition();
  // Requests the addition of the proposed effects; false without a proposal.
  bool add_proposed();
  void added(std::int64_t k);
  // [[effect]] tables to be removed from the running processes, once. Pass the answer to
  // removed() or refused().
  std::optional<std::string> take_removal();
  void removed(std::int64_t k);
  void refused(const std::string& why);

  std::int64_t last_k() const { return rows_.empty() ? -1 : rows_.back().m.k; }
  // A tick far enough ahead for the request to reach every process before it.
  std::int64_t tick_for_request() const;
  const std::vector<Episode>& episodes() const { return episodes_; }
  const char* phase() const;
  std::string to_json() const;

 private:
  LiveMonitor(const DriveConfig& drive, const MonitorParameters& parameters);
  enum class Phase {
    kLearning,
    kWatching,
    kGathering,
    kTracing,
    kProposed,
    kAdding,
    kComparing,
    kRemoving,
  };
  void block_done();
  void learn(std::size_t first, std::size_t last);
  void watch(std::size_t first, std::size_t last);
  void gather();
  void compare();
  void report_comparison(std::int64_t from, std::int64_t to);
  // Removes the added effects that are worse than none; true if there is one.
  bool take_back_worse();
  void take_back(std::vector<std::size_t> places, const std::string& why);
  // The innovation that is worse after the last addition, in words; empty: none.
  std::string worse_innovation(std::int64_t from, std::int64_t to) const;
  void report_no_result(const std::string& why);
  // True if every gathered block fits the model with the proposed effects.
  bool fits_throughout() const;
  void relearn();
  void notify(Reason reason, const std::string& text);
  std::size_t row_of(std::int64_t k) const;
  double t_s(std::int64_t k) const { return static_cast<double>(k) * drive_.T_s(); }
  std::int64_t ticks(double seconds) const;
  std::vector<double> innovation_rms(std::int64_t from, std::int64_t to) const;

  DriveConfig drive_;  // effects: the declared ones and those added
  MonitorParameters parameters_;
  MisfitWatch watch_;
  DeclaredLoad load_;
  std::int64_t block_ticks_, window_ticks_;
  std::deque<MeasuredRow> rows_;
  std::deque<Estimate> estimates_;
  Phase phase_ = Phase::kLearning;
  std::int64_t block_begin_ = -1, learn_until_ = -1;
  int misfit_blocks_ = 0, restarts_ = 0;
  std::int64_t gather_from_ = -1, gather_ticks_ = 0;  // gather_ticks_: length to be traced
  std::int64_t added_k_ = -1;
  std::vector<ConfiguredEffect> proposed_;
  std::vector<Episode> episodes_;
  std::vector<MonitorNotice> notices_;
  std::optional<TraceJob> job_;
  std::optional<std::string> addition_, removal_;
  AddedEffects added_;                 // the last effects of drive_
  std::vector<std::size_t> removing_;  // indices in added_, ascending
};

}  // namespace twinrate
