#include "monitor/live_monitor.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "core/config_write.hpp"
#include "model/effects/tracing.hpp"
#include "trace/tracer.hpp"

namespace twinrate {
namespace {

constexpr int kMisfitBlocksToNotice = 2;  // consecutive
constexpr int kMaxRestarts = 2;
constexpr double kRequestLead_s = 0.1;  // from a request to the tick at which it holds
constexpr double kSettling_s = 0.25;    // from an addition to the comparison
constexpr double kComparison_s = 1.0;
constexpr double kJudgingShare = 1.0 / 3;  // of the traced data, their last rows
constexpr double kUsableShare = 0.5;       // of the rows that judge, so that they can

const char* const kPhaseNames[] = {"learning", "watching", "gathering", "tracing",
                                   "proposed", "adding",   "comparing", "removing"};

std::string toml_of(const std::vector<ConfiguredEffect>& effects) {
  DriveConfig only;
  only.effects = effects;
  std::string text = write_effects(only);
  return text.substr(std::min(text.size(), text.find_first_not_of('\n')));
}

// "# sigma dead_time.dead_time 1.2e-09 s": comments in front of the [[effect]] tables.
std::string sigmas_of(const TraceResult& result) {
  std::string text;
  for (const TracedEffect& e : result.effects)
    for (const TracedParameter& p : e.parameters)
      if (p.sigma)
        text +=
            fmt::format("# sigma {}.{} {:.2g} {}\n", e.effect->kind(), p.name, *p.sigma, p.unit);
  return text;
}

std::string side_by_side(double before, double after, const char* unit) {
  return fmt::format("{:.3g} -> {:.3g}{}", before, after, unit);
}

}  // namespace

TraceResult run(const TraceJob& job, std::function<bool()> stop) {
  std::size_t judging = 0, usable = 0;
  for (std::size_t k = 0; k < job.judging.size(); ++k) {
    judging += job.judging[k] != 0;
    usable += job.judging[k] && job.record.electrical_ok[k];
  }
  if (static_cast<double>(usable) < kUsableShare * static_cast<double>(judging)) {
    TraceResult nothing;
    nothing.verdict = "ambiguous";
    nothing.sentence = "Cannot tell: most held-out rows cannot be used.";
    return nothing;
  }
  TraceSettings settings{.stop = std::move(stop)};
  settings.fit_judging_rows = true;  // passed effects are fitted to all rows
  return trace_record(job.record, job.drive, job.health, settings, job.judging);
}

LiveMonitor::LiveMonitor(const DriveConfig& drive, const MonitorParameters& parameters)
    : drive_(drive),
      parameters_(parameters),
      watch_(drive_),
      load_(drive_),
      block_ticks_(ticks(parameters_.block_s)),
      window_ticks_(ticks(parameters_.window_s)) {}

LiveMonitor::LiveMonitor(Config& config)
    : LiveMonitor(config.drive(), config.read<MonitorParameters>()) {
  const MonitorParameters& p = parameters_;
  const auto need = [&](bool good, const char* key, const std::string& allowed) {
    if (!good) throw BadInput(fmt::format("{}: {}: {}", config.where(key), key, allowed));
  };
  need(p.learn_s >= 2 * p.block_s, "monitor.learn_s", "at least two blocks (monitor.block_s)");
  need(p.gather_s <= p.window_s, "monitor.gather_s", "at most monitor.window_s");
  need(block_ticks_ >= 200, "monitor.block_s", "at least 200 ticks");
}

void LiveMonitor::restart() {
  AddedEffects added = std::move(added_);
  *this = LiveMonitor(DriveConfig(drive_), MonitorParameters(parameters_));
  added_ = std::move(added);
  added_.restart();
}

std::int64_t LiveMonitor::ticks(double seconds) const {
  return std::max<std::int64_t>(1, std::llround(seconds * drive_.rates.f_s_Hz));
}

const char* LiveMonitor::phase() const {
  return kPhaseNames[static_cast<int>(phase_)];
}

void LiveMonitor::notify(Reason reason, const std::string& text) {
  notices_.push_back({reason, last_k(), text});
}

std::vector<MonitorNotice> LiveMonitor::take_notices() {
  return std::exchange(notices_, {});
}
std::optional<TraceJob> LiveMonitor::take_job() {
  return std::exchange(job_, {});
}
std::optional<std::string> LiveMonitor::take_addition() {
  return std::exchange(addition_, {});
}
std::optional<std::string> LiveMonitor::take_removal() {
  return std::exchange(removal_, {});
}

// First row at or after tick k.
std::size_t LiveMonitor::row_of(std::int64_t k) const {
  return static_cast<std::size_t>(
      std::lower_bound(rows_.begin(), rows_.end(), k,
                       [](const MeasuredRow& row, std::int64_t tick) { return row.m.k < tick; }) -
      rows_.begin());
}

void LiveMonitor::take(const Measurement& m) {
  if (m.k <= last_k()) return;  // repeated message
  rows_.push_back({m, load_.at(t_s(m.k))});
  const std::int64_t keep = window_ticks_ + 4 * block_ticks_;
  while (m.k - rows_.front().m.k > keep) rows_.pop_front();
  while (!estimates_.empty() && m.k - estimates_.front().k > keep) estimates_.pop_front();
  if (block_begin_ < 0) {
    if (t_s(m.k) >= drive_.run.settle_s) block_begin_ = m.k;
    return;
  }
  if (m.k - block_begin_ >= block_ticks_) block_done();
}

void LiveMonitor::take(const Estimate& e) {
  if (e.k == last_k() && (estimates_.empty() || e.k > estimates_.back().k)) estimates_.push_back(e);
}

// A block is judged a few rows after its end: its last voltage comes with the next row.
void LiveMonitor::block_done() {
  const std::size_t first = row_of(block_begin_), last = rows_.size();
  block_begin_ = rows_.back().m.k;
  const bool judged = phase_ == Phase::kWatching || phase_ == Phase::kGathering ||
                      phase_ == Phase::kProposed || phase_ == Phase::kComparing;
  if (judged) added_.judge(watch_, drive_, rows_, first, last);
  if (judged && phase_ != Phase::kComparing && take_back_worse()) return;
  if (phase_ == Phase::kLearning)
    learn(first, last);
  else if (phase_ == Phase::kWatching)
    watch(first, last);
  else if (phase_ == Phase::kGathering)
    gather();
  else if (phase_ == Phase::kComparing)
    compare();
}

static std::vector<Estimate> between(const std::deque<Estimate>& estimates, std::int64_t first,
                                     std::int64_t last) {
  std::vector<Estimate> some;
  for (const Estimate& e : estimates)
    if (e.k >= first && e.k < last) some.push_back(e);
  return some;
}

void LiveMonitor::learn(std::size_t first, std::size_t last) {
  const std::int64_t k = rows_.back().m.k;
  watch_.learn(rows_, first, last, between(estimates_, rows_[first].m.k, k),
               drive_.model_effects());
  if (learn_until_ < 0) learn_until_ = rows_[first].m.k + ticks(parameters_.learn_s);
  if (k < learn_until_) return;
  if (watch_.learnt())
    phase_ = Phase::kWatching;
  else
    relearn();
}

void LiveMonitor::relearn() {
  watch_ = MisfitWatch(drive_);
  learn_until_ = -1;
  phase_ = Phase::kLearning;
}

void LiveMonitor::watch(std::size_t first, std::size_t last) {
  const std::int64_t k = rows_.back().m.k;
  const BlockVerdict verdict = watch_.test(
      rows_, first, last, between(estimates_, rows_[first].m.k, k), drive_.model_effects());
  misfit_blocks_ = verdict.fits ? 0 : misfit_blocks_ + 1;
  if (misfit_blocks_ == 1) gather_from_ = k;
  if (misfit_blocks_ < kMisfitBlocksToNotice) return;
  misfit_blocks_ = 0;
  Episode episode;
  episode.noticed_s = t_s(k);
  episode.sign = verdict.text();
  restarts_ = 0;
  episodes_.push_back(episode);
  notify(Reason::kModelMisfit, "the model no longer fits: " + episode.sign);
  gather_ticks_ = ticks(parameters_.gather_s);
  phase_ = Phase::kGathering;
}

void LiveMonitor::gather() {
  if (last_k() - gather_from_ < gather_ticks_) return;
  gather_from_ = std::max(gather_from_, last_k() - window_ticks_);
  const RawLog raw = raw_log_of(rows_, row_of(gather_from_), rows_.size());
  if (static_cast<std::int64_t>(raw.size()) < block_ticks_) {
    report_no_result("Currents and angle are not measured.");
    return;
  }
  TraceJob job;
  job.drive = drive_;
  job.record = make_record(raw, drive_.machine.n_p, job.health, drive_.sensors.encoder_counts);
  job.judging.assign(job.record.size(), 0);
  const auto judging = static_cast<std::ptrdiff_t>(
      std::llround(kJudgingShare * static_cast<double>(job.record.size())));
  std::fill(job.judging.end() - judging, job.judging.end(), 1);
  episodes_.back().traced_s = t_s(last_k() - gather_from_);
  job_ = std::move(job);
  phase_ = Phase::kTracing;
}

void LiveMonitor::report_no_result(const std::string& why) {
  episodes_.back().sentence = why;
  notify(Reason::kNothingTraced, why + " The present residuals are the new reference.");
  relearn();
}

void LiveMonitor::traced(const TraceResult& result) {
  Episode& episode = episodes_.back();
  episode.sentence = result.sentence;
  episode.verdict = result.verdict;
  proposed_.clear();
  for (const TracedEffect& e : result.effects) {
    if (result.interrupted || e.effect->tracing().traced_keys().empty()) continue;
    proposed_.push_back({e.effect, UsedIn::kModel});
  }
  if (proposed_.empty()) {
    if (gather_ticks_ == window_ticks_) {
      report_no_result(result.sentence);
      return;
    }
    gather_ticks_ = std::min(2 * gather_ticks_, window_ticks_);
    phase_ = Phase::kGathering;
    return;
  }
  const bool unexplained = result.verdict == "unexplained";
  if (unexplained && restarts_ == kMaxRestarts) {
    proposed_.clear();
    report_no_result("Not added, because a part beside it is unexplained. " + result.sentence);
    return;
  }
  if (restarts_ < kMaxRestarts && (unexplained || !fits_throughout())) {
    ++restarts_;
    proposed_.clear();
    gather_from_ = last_k();
    gather_ticks_ = ticks(parameters_.gather_s);
    phase_ = Phase::kGathering;
    return;
  }
  episode.kinds.clear();
  for (const ConfiguredEffect& e : proposed_) episode.kinds.emplace_back(e.effect->kind());
  episode.toml = toml_of(proposed_);
  episode.proposed_s = t_s(last_k());
  notify(Reason::kEffectProposed,
         "# " + episode.sentence + "\n" + sigmas_of(result) + episode.toml);
  phase_ = Phase::kProposed;
  if (parameters_.auto_add) add_proposed();
}

bool LiveMonitor::fits_throughout() const {
  DriveConfig extended = drive_;
  extended.effects.insert(extended.effects.end(), proposed_.begin(), proposed_.end());
  const Effects model_effects = extended.model_effects();
  const std::int64_t first =
      std::max(gather_from_, rows_.front().m.k);  // rows are dropped during a long trace

  for (std::int64_t k = first; k + block_ticks_ <= gather_from_ + gather_ticks_;
       k += block_ticks_) {
    const BlockVerdict block =
        watch_.test(rows_, row_of(k), row_of(k + block_ticks_), {}, model_effects);
    for (const ChannelLevel& channel : block.channels)
      if (channel.excess > MisfitWatch::kMaxRise) return false;
  }
  return true;
}

bool LiveMonitor::add_proposed() {
  if (phase_ != Phase::kProposed) return false;
  addition_ = episodes_.back().toml;
  phase_ = Phase::kAdding;
  return true;
}

std::int64_t LiveMonitor::tick_for_request() const {
  return last_k() + ticks(kRequestLead_s);
}

void LiveMonitor::added(std::int64_t k) {
  drive_.effects.insert(drive_.effects.end(), proposed_.begin(), proposed_.end());
  added_.add(proposed_, episodes_.size() - 1, k + ticks(kSettling_s));
  added_k_ = k;
  episodes_.back().added_s = t_s(k);
  phase_ = Phase::kComparing;
}

void LiveMonitor::refused(const std::string& why) {
  notify(Reason::kNothingTraced,
         fmt::format("the effect was not {}: {}", phase_ == Phase::kRemoving ? "removed" : "added",
                     why));
  removing_.clear();
  relearn();
}

bool LiveMonitor::take_back_worse() {
  const std::optional<Worse> worse = added_.worst();
  if (!worse) return false;
  take_back(
      {worse->place},
      fmt::format("the residual error of the rows since is larger with it, by {:.2g} % in the "
                  "median of {} pieces (signed-rank p {:.1g})",
                  100 * worse->rise, worse->votes, worse->p_value));
  return true;
}

void LiveMonitor::take_back(std::vector<std::size_t> places, const std::string& why) {
  std::vector<ConfiguredEffect> effects;
  std::vector<std::string> kinds;
  for (const std::size_t place : places) {
    const AddedEffect& a = added_[place];
    effects.push_back(a.effect);
    kinds.emplace_back(a.effect.effect->kind());
    if (!a.episode) continue;
    Episode& episode = episodes_[*a.episode];
    episode.taken_back_s = t_s(last_k());
    episode.taken_back += (episode.taken_back.empty() ? "" : "; ") + kinds.back() + ": " + why;
  }
  notify(Reason::kEffectTakenBack,
         fmt::format("{} is taken back: {}", fmt::join(kinds, " + "), why));
  removing_ = std::move(places);
  proposed_.clear();  // traced beside the effects that are removed
  addition_.reset();
  removal_ = toml_of(effects);
  phase_ = Phase::kRemoving;
}

void LiveMonitor::removed(std::int64_t) {
  for (; !removing_.empty(); removing_.pop_back()) {
    const auto from_end = static_cast<std::ptrdiff_t>(added_.size() - removing_.back());
    drive_.effects.erase(drive_.effects.end() - from_end);
    added_.remove(removing_.back());
  }
  relearn();
}

std::vector<double> LiveMonitor::innovation_rms(std::int64_t from, std::int64_t to) const {
  std::vector<double> sums;
  double count = 0;
  for (const Estimate& e : estimates_) {
    if (e.k < from || e.k >= to) continue;
    sums.resize(static_cast<std::size_t>(e.n_y));
    for (int i = 0; i < e.n_y; ++i) sums[static_cast<std::size_t>(i)] += e.innov[i] * e.innov[i];
    ++count;
  }
  for (double& sum : sums) sum = std::sqrt(sum / count);
  return sums;
}

// Residuals: the same rows without and with the effects. Innovations: before and after the
// addition.
void LiveMonitor::compare() {
  const std::int64_t from = added_k_ + ticks(kSettling_s), to = from + ticks(kComparison_s);
  if (rows_.back().m.k < to) return;
  report_comparison(from, to);
  const std::size_t added = std::exchange(proposed_, {}).size();
  phase_ = Phase::kWatching;
  if (take_back_worse()) return;
  if (const std::string worse = worse_innovation(from, to); !worse.empty()) {
    std::vector<std::size_t> places;
    for (std::size_t place = added_.size() - added; place < added_.size(); ++place)
      places.push_back(place);
    take_back(std::move(places), worse);
    return;
  }
  for (std::int64_t k = from; k + block_ticks_ <= to; k += block_ticks_)
    watch_.accept(rows_, row_of(k), row_of(k + block_ticks_),
                  between(estimates_, k, k + block_ticks_), drive_.model_effects());
}

void LiveMonitor::report_comparison(std::int64_t from, std::int64_t to) {
  Episode& episode = episodes_.back();
  const std::size_t first = row_of(from), last = row_of(to);
  DriveConfig without = drive_;
  without.effects.resize(without.effects.size() - proposed_.size());
  episode.before = residual_rms(drive_, rows_, first, last, without.model_effects());
  episode.after = residual_rms(drive_, rows_, first, last, drive_.model_effects());
  episode.innovation_before = innovation_rms(added_k_ - ticks(kComparison_s), added_k_);
  episode.innovation_after = innovation_rms(from, to);
  episode.compared_s = t_s(last_k());
  std::vector<std::string> innovations;
  for (std::size_t i = 0;
       i < std::min(episode.innovation_before.size(), episode.innovation_after.size()); ++i)
    innovations.push_back(
        side_by_side(episode.innovation_before[i], episode.innovation_after[i], ""));
  notify(Reason::kEffectCompared,
         fmt::format("{} added at tick {}: voltage residual {}, torque residual {}, innovations {}",
                     fmt::join(episode.kinds, " + "), added_k_,
                     side_by_side(episode.before.voltage, episode.after.voltage, " V"),
                     side_by_side(episode.before.torque, episode.after.torque, " Nm"),
                     fmt::join(innovations, ", ")));
}

// Blocks of the second before the addition and of the compared one: of a channel, the quietest
// after against the loudest before.
std::string LiveMonitor::worse_innovation(std::int64_t from, std::int64_t to) const {
  std::map<std::string, double> loudest_before, quietest_after;
  const auto look = [&](std::int64_t begin, std::int64_t end, bool after) {
    for (std::int64_t k = std::max(begin, rows_.front().m.k); k + block_ticks_ <= end;
         k += block_ticks_)
      for (const ChannelLevel& c :
           watch_
               .test(rows_, row_of(k), row_of(k + block_ticks_),
                     between(estimates_, k, k + block_ticks_), drive_.model_effects())
               .channels) {
        if (!c.of_filter()) continue;
        double& level =
            (after ? quietest_after : loudest_before).try_emplace(c.name, c.excess).first->second;
        level = after ? std::min(level, c.excess) : std::max(level, c.excess);
      }
  };
  look(added_k_ - ticks(kComparison_s), added_k_, false);
  look(from, to, true);
  for (const auto& [name, after] : quietest_after)
    if (const auto before = loudest_before.find(name);
        before != loudest_before.end() && after > MisfitWatch::kMargin * before->second)
      return fmt::format("{} of the running filter is at least {:.2g} times that before (rms)",
                         name, std::sqrt(after / before->second));
  return "";
}

std::string LiveMonitor::to_json() const {
  using Json = nlohmann::ordered_json;
  Json list = Json::array();
  const auto moment = [](double t) { return t > 0 ? Json(t) : Json(nullptr); };
  for (const Episode& e : episodes_)
    list.push_back({{"noticed_s", e.noticed_s},
                    {"sign", e.sign},
                    {"traced_s", e.traced_s},
                    {"verdict", e.verdict},
                    {"sentence", e.sentence},
                    {"kinds", e.kinds},
                    {"effect_toml", e.toml},
                    {"proposed_s", moment(e.proposed_s)},
                    {"added_s", moment(e.added_s)},
                    {"compared_s", moment(e.compared_s)},
                    {"taken_back_s", moment(e.taken_back_s)},
                    {"taken_back", e.taken_back},
                    {"voltage_residual_rms_V", {e.before.voltage, e.after.voltage}},
                    {"torque_residual_rms_Nm", {e.before.torque, e.after.torque}},
                    {"innovation_rms_before", e.innovation_before},
                    {"innovation_rms_after", e.innovation_after}});
  return Json{{"phase", phase()}, {"last_tick", last_k()}, {"episodes", list}}.dump(2) + "\n";
}

}  // namespace twinrate
