// Watches a running drive, and says what its model lacks. Pure: messages in, notices and requests
// out; twinrate-monitor puts it on the bus, `twinrate simulate` into its own loop.
//
//   learning -> watching -> (two blocks in a row do not fit) gathering -> tracing -> proposed
//            -> adding -> comparing -> watching ..
//
// Traced is what came after the first block that did not fit, gather_s of it at first; where that
// does not tell, twice as much, up to window_s. Where the whole window does not tell either, that
// is said, and the monitor learns anew what is normal. Where what was traced fits a part of the
// data only, another effect began meanwhile: gathering starts again, up to kMostRestarts times, so
// that all of them are there all the time. After an effect was added, the residual of
// the same following data is formed with and without it, and the filter's innovations before and
// after are put side by side.
#pragma once
#include <functional>
#include <optional>

#include "core/config.hpp"
#include "core/reason.hpp"
#include "monitor/misfit_watch.hpp"
#include "monitor/monitor_parameters.hpp"
#include "trace/result.hpp"

namespace twinrate {

struct MonitorNotice {
  Reason reason = Reason::kNone;
  std::int64_t k = -1;
  std::string text;
};

// One misfit, from the first sign to the figures afterwards.
struct Episode {
  double noticed_s = 0, proposed_s = 0, added_s = 0, compared_s = 0;  // drive time; 0: not yet
  double traced_s = 0;                                                // length of data
  std::string sign, sentence, toml;
  std::vector<std::string> kinds;
  ResidualRms before, after;                                // of the data after it was added
  std::vector<double> innovation_before, innovation_after;  // rms by output
};

struct TraceJob {
  Record record;
  Health health;
  DriveConfig drive;  // with the effects added so far
};
// Runs anywhere; takes a second or so. `stop` as in TraceSettings.
TraceResult run(const TraceJob& job, std::function<bool()> stop = {});

class LiveMonitor {
 public:
  // Throws BadInput where monitor.* do not go together.
  explicit LiveMonitor(Config& config);

  // Another run of the drive: all is forgotten but the effects added, which the processes keep.
  void begin_anew();

  // In this order each tick; an estimate of a tick that was not measured here is left out.
  void take(const Measurement& m);
  void take(const Estimate& e);

  std::vector<MonitorNotice> take_notices();
  // A stretch to be traced, once; its result comes back by traced().
  std::optional<TraceJob> take_job();
  void traced(const TraceResult& result);
  // [[effect]] tables to be added to the running processes, once: by monitor.auto_add, or because
  // somebody asked. The answer comes back by added() or refused().
  std::optional<std::string> take_addition();
  // Asks for what was proposed to be added; false where nothing is proposed.
  bool add_proposed();
  void added(std::int64_t k);
  void refused(const std::string& why);

  std::int64_t last_k() const { return rows_.empty() ? -1 : rows_.back().m.k; }
  // A tick far enough ahead for every process to hear of it in time.
  std::int64_t tick_for_addition() const;
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
  };
  void block_done();
  void learn(std::size_t first, std::size_t last);
  void watch(std::size_t first, std::size_t last);
  void gather();
  void compare();
  void nothing_traced(const std::string& why);
  // The gathered blocks under the model with what is proposed.
  bool fits_throughout() const;
  void learn_anew();
  void say(Reason reason, const std::string& text);
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
  int failed_in_a_row_ = 0, restarts_ = 0;
  std::int64_t gather_from_ = -1, gather_ticks_ = 0;  // gather_ticks_: that are to be traced
  std::int64_t added_k_ = -1;
  std::vector<ConfiguredEffect> proposed_;
  std::vector<Episode> episodes_;
  std::vector<MonitorNotice> notices_;
  std::optional<TraceJob> job_;
  std::optional<std::string> addition_;
};

}  // namespace twinrate
