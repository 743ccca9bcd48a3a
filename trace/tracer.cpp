#include "trace/tracer.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <optional>

#include "model/effects/materiality.hpp"
#include "trace/angle_zero.hpp"
#include "trace/bus_applied.hpp"
#include "trace/conclude.hpp"
#include "trace/consistency.hpp"
#include "trace/doubts.hpp"
#include "trace/either_meaning.hpp"
#include "trace/findings.hpp"
#include "trace/half_rate.hpp"
#include "trace/keys.hpp"
#include "trace/search.hpp"
#include "trace/slips.hpp"
#include "trace/thinning.hpp"
#include "trace/voltage_meaning.hpp"

namespace twinrate {
namespace {

JudgedFiles judged_files(const std::vector<SourceRows>& sources, const Record& whole,
                         std::size_t rows) {
  JudgedFiles files;
  if (sources.empty()) {
    files.files.push_back({whole.source, false, whole.size()});
    return files;
  }
  std::vector<int> of_row(whole.size(), 0);
  for (const SourceRows& source : sources) {
    std::fill(of_row.begin() + static_cast<std::ptrdiff_t>(source.first),
              of_row.begin() + static_cast<std::ptrdiff_t>(source.end),
              static_cast<int>(files.files.size()));
    files.files.push_back({source.path, source.held_out, source.end - source.first});
  }
  files.of_row = thinned(of_row, whole, rows);
  return files;
}

// Least size of an effect beyond the uncertainty of the voltage's frame and moment.
double least_beside(const VoltageMeaning& voltage, const Effect& effect, const DriveFacts& facts) {
  if (voltage.open_s == 0 || effect.acts_on() == kOnSpeed) return 0;
  const std::shared_ptr<Effect> open = effect.clone();
  if (is_of(effect, Traits::Family::kLag))
    set_key(*open, "lag_s", voltage.open_s);
  else if (effect.acts_on() & kOnAngle && has_key(effect, "offset_rad"))
    set_key(*open, "offset_rad", voltage.open_e / facts.machine.n_p);
  else
    return 0;
  return open->tracing().materiality(facts);
}

// True if most rows have a current of fewer than two steps.
bool mostly_few_steps(const Record& record, double i_lsb) {
  const auto few =
      std::count_if(record.i_alphabeta.begin(), record.i_alphabeta.end(),
                    [&](const Vec2& i) { return i.squaredNorm() < 4 * i_lsb * i_lsb; });
  return 2 * static_cast<std::size_t>(few) > record.i_alphabeta.size();
}

// Size of the constant torque from half a step of a current sensor. If the current covers few
// steps, that much of it is missing as long as it stays at its value.
double least_beside_steps(const Record& record, const Health& health, const Effect& effect,
                          const DriveFacts& facts) {
  if (effect.tracing().traits().equation != Traits::Equation::kMechanical ||
      !health.coarse(facts.machine.i_rated) || !mostly_few_steps(record, health.i_lsb))
    return 0;
  const MachineParameters& m = facts.machine;
  return 1.5 * m.n_p * m.psi_f * health.i_lsb / 2 / smallest_torque(facts, 10e-3);
}

std::vector<Gate::Doubt> doubts_of(const Record& log, const DriveFacts& facts) {
  std::vector<Gate::Doubt> doubts;
  if (std::string why = sign_in_doubt(log, facts); !why.empty())
    doubts.push_back({"sign", std::move(why), false, true, false});
  if (Slip slip = slip_that_fits(log, facts); !slip.text.empty())
    doubts.push_back({"slip", std::move(slip.text), slip.voltage, slip.torque, slip.frame});
  return doubts;
}

// The voltage equation takes the currents between two rows as a cubic in rotor axes. For a vector
// that turns by 1 rad the error is 0.2 %: a row after a larger turn has no voltage equation.
constexpr double kMostTurn = 1;  // rad, electrical
constexpr std::size_t kFewestRows = 200;

bool turns_far(const Record& record, std::size_t k, int n_p) {
  return k > 0 && std::abs(n_p * (record.theta_m[k] - record.theta_m[k - 1])) > kMostTurn;
}

std::size_t fast_rows(const Record& record, int n_p) {
  std::size_t rows = 0;
  if (record.has_voltage_equation())
    for (std::size_t k = 1; k < record.size(); ++k)
      rows += record.electrical_ok[k] && turns_far(record, k, n_p);
  return rows;
}

void leave_out_fast_rows(Record& record, int n_p) {
  for (std::size_t k = 1; k < record.size(); ++k)
    if (turns_far(record, k, n_p)) record.electrical_ok[k] = 0;
}

// A log with the meaning of its voltage, and the rows that have a voltage equation.
struct Readable {
  std::optional<Record> changed;  // as its equations need it; empty: unchanged
  VoltageMeaning voltage;
  std::string fast;        // the rows without a voltage equation
  std::string no_voltage;  // the reason why no row has one
};

Readable readable(const Record& log, const DriveFacts& facts, VoltageMeaning voltage) {
  const int n_p = facts.machine.n_p;
  Readable r{.changed = {}, .voltage = std::move(voltage), .fast = {}, .no_voltage = {}};
  if (r.voltage.of_tick) r.changed = with_mean_of_ticks(log, facts);
  const std::size_t rows = fast_rows(log, n_p);
  if (rows == 0) return r;
  r.fast = fmt::format(
      "{:.0f} % of the rows: the rotor turns by more than {} rad electrical up to the next",
      100. * static_cast<double>(rows) / static_cast<double>(log.size()), kMostTurn);
  if (log.size() - rows < kFewestRows) {
    r.no_voltage = r.fast + ": no electrical effect is traced. Log more rows a second";
    return r;
  }
  r.fast += ": they have no voltage equation";
  if (!r.changed) r.changed = log;
  leave_out_fast_rows(*r.changed, n_p);
  return r;
}

// The trace of one log of one drive, from its rows to the missing effects.
class Tracing {
 public:
  Tracing(const Record& log, const DriveConfig& drive, const Health& health,
          const TraceSettings& settings)
      : log_(log),
        drive_(drive),
        facts_(drive.facts()),
        known_(drive.model_effects()),
        health_(health),
        settings_(settings),
        laps_(settings.say) {}

  // `judging`: of each row, whether it judges; empty: blocks of the log.
  TraceResult operator()(std::vector<char> judging);

 private:
  TraceResult of_meaning(VoltageMeaning voltage, std::vector<char> judging, bool given);
  // What a mean and a tick's value both show, or what one of them explains; else the trace without
  // the voltage.
  TraceResult of_either(const VoltageMeaning& voltage, std::vector<char> judging, bool given);
  TraceResult trace_rows(const Readable& log, std::vector<char> judging, bool given);
  // The record with the voltage that acted under the ripple of the bus.
  std::optional<Record> as_bus_acted(const Record& raw, BusRipple& bus) const;
  Findings found(DriveProblem& problem, Search& search, const JudgedFiles& files,
                 const VoltageMeaning& voltage);
  void tell_refused(const std::vector<Refused>& refused) const;
  // Traces another log of the drive and adds the reason to the result: the log without voltages, or
  // with another zero of the angle. If the judging rows were not given, the passed effects are
  // fitted to them as well.
  TraceResult of_other(const Record& log, std::string why, std::vector<char> judging,
                       bool given) const;
  TraceResult without_voltage(std::string why, std::vector<char> judging, bool given) const;
  TraceResult from_zero(double by, std::string why, std::vector<char> judging, bool given) const;

  const Record& log_;
  const DriveConfig& drive_;
  const DriveFacts facts_;
  const Effects known_;
  const Health& health_;
  const TraceSettings& settings_;
  Laps laps_;
  static constexpr int kMostFreed = 2;
  int freed_ = 0;  // with a moment, which no longer judge
};

TraceResult Tracing::of_other(const Record& log, std::string why, std::vector<char> judging,
                              bool given) const {
  TraceSettings same = settings_;
  same.fit_judging_rows = settings_.fit_judging_rows || !given;
  TraceResult r = Tracing(log, drive_, health_, same)(std::move(judging));
  r.health.push_back(std::move(why));
  return r;
}

TraceResult Tracing::without_voltage(std::string why, std::vector<char> judging, bool given) const {
  Record rest = log_;
  rest.u_alphabeta.clear();
  TraceResult r = of_other(rest, std::move(why), std::move(judging), given);
  r.sentence += " The voltage was not used: no electrical effect is traced.";
  return r;
}

TraceResult Tracing::from_zero(double by, std::string why, std::vector<char> judging,
                               bool given) const {
  return of_other(moved(log_, by), std::move(why), std::move(judging), given);
}

std::optional<Record> Tracing::as_bus_acted(const Record& raw, BusRipple& bus) const {
  Effects on_bus = known_;
  if (!bus.own_clocks)
    for (const TracedEffect& e : bus.effects) on_bus.push_back(e.effect);
  if (acting_on(on_bus, kOnBus).empty()) return std::nullopt;
  Record applied = as_applied(raw, on_bus);
  if (!acted(raw, applied, facts_.machine)) {
    applied.u_alphabeta = raw.u_alphabeta;
    bus.notes.push_back(
        "the logged voltage already contains the ripple of v_dc and is used unchanged");
  }
  return applied;
}

// Throws TraceStopped.
Findings Tracing::found(DriveProblem& problem, Search& search, const JudgedFiles& files,
                        const VoltageMeaning& voltage) {
  const Chain& chain = problem.seen();
  const Rows none, not_judging = Rows::where(chain.sampler(), [](std::size_t) { return true; });
  std::optional<std::vector<Gate::Doubt>> doubts;
  const auto find = [&](Fit from) {
    Findings f;
    f.selection = search(std::move(from));
    f.passed = not_asked(f.selection);
    f.noise = chain.noise();
    const Rows judging(problem.all().sampler(), true);
    if (judging.electrical() + judging.torque() == 0) return f;
    const Fitter seen(chain, not_judging, none);
    Gate gate(seen, problem.all(), files);
    gate.set_resolution([&](const Effect& effect) {
      return std::max(least_beside(voltage, effect, facts_),
                      least_beside_steps(log_, health_, effect, facts_));
    });
    gate.set_rounded(log_.angle.lsb > 0 || health_.coarse(facts_.machine.i_rated));
    gate.set_doubts([&] {
      if (!doubts) doubts = doubts_of(log_, facts_);
      return *doubts;
    });
    std::optional<HalfRate> half;
    gate.set_half_rate([&]() -> const HalfRate& {
      if (!half)
        half.emplace(problem.whole(), problem.noisier(), 2 * problem.rows(), facts_, known_,
                     f.selection.fit.effects(), chain.noise());
      return *half;
    });
    f.passed = gate(f.selection.fit.members);
    return f;
  };
  // Compares under the noise of the first model: the part that this model explained is noise to the
  // second.
  const auto as_much = [&](const Findings& first, const Findings& second) {
    problem.set_noise(first.noise);
    return explains_as_much(Fitter(chain, not_judging, none), first.passed.fit.members,
                            first.selection.fit.members, second.passed.fit.members);
  };
  const auto again = [&](Fit from, const std::vector<std::string>& left_out) {
    search.leave_out(left_out);
    return find(std::move(from));
  };
  Findings f = without_wrong_kinds(find({}), again, as_much);
  problem.set_noise(f.noise);
  search.leave_out(impossible_kinds(f.passed.refused));
  return f;
}

void Tracing::tell_refused(const std::vector<Refused>& refused) const {
  if (!settings_.say) return;
  for (const Refused& r : refused)
    settings_.say(fmt::format("  {} refused: {}{}{}, {}", r.kind, r.rule,
                              r.file.empty() ? "" : ", ", r.file, r.text));
}

TraceResult Tracing::operator()(std::vector<char> judging) {
  const auto cannot_tell = [&](const std::string& why) {
    TraceResult r;
    r.verdict = "ambiguous";
    r.sentence = "Cannot tell: " + why + ".";
    r.health = health_.lines();
    return r;
  };
  if (!health_.blind.empty()) return cannot_tell(health_.blind);
  auto found = inconsistencies(log_, health_, facts_, drive_.sensors.encoder_counts);
  if (const std::string why = hidden_turns(log_, health_, facts_, found); !why.empty())
    return cannot_tell(why);
  if (!found.empty()) return inconsistent_result(std::move(found), health_);
  const VoltageMeaning voltage = voltage_meaning(log_, facts_);
  const bool given = !judging.empty();
  return voltage.doubt.empty() ? of_meaning(voltage, std::move(judging), given)
                               : of_either(voltage, std::move(judging), given);
}

TraceResult Tracing::of_meaning(VoltageMeaning voltage, std::vector<char> judging, bool given) {
  Readable log = readable(log_, facts_, std::move(voltage));
  if (!log.no_voltage.empty())
    return without_voltage(std::move(log.no_voltage), std::move(judging), given);
  if (!given)
    judging =
        held_out_rows(log.changed ? *log.changed : log_, settings_.holdout, facts_.machine.n_p);
  freed_ = 0;
  return trace_rows(log, std::move(judging), given);
}

TraceResult Tracing::of_either(const VoltageMeaning& voltage, std::vector<char> judging,
                               bool given) {
  const auto as = [&](bool of_tick) {
    return of_meaning({.doubt = "",
                       .of_tick = of_tick,
                       .open_e = voltage.open_e,
                       .open_s = voltage.open_s,
                       .told = ""},
                      judging, given);
  };
  TraceResult of_mean = as(false), of_tick = as(true);
  std::optional<TraceResult> r = shown_by_both(of_mean, of_tick);
  std::string how = "it was traced as either, with the same effects";
  if (!r && explains_alone(of_mean, of_tick)) {
    r = std::move(of_mean);
    how = "taken for the mean, beside which the effects leave no structure";
  } else if (!r && explains_alone(of_tick, of_mean)) {
    r = std::move(of_tick);
    how = "taken for a tick's, beside which the effects leave no structure";
  }
  if (!r)
    return without_voltage(voltage.doubt +
                               ": no electrical effect is confirmed for both, and none is "
                               "traced. Log every tick, or the mean voltage from row to row in "
                               "stator axes",
                           std::move(judging), given);
  r->health.push_back(fmt::format(
      "{}: {}; an encoder_offset below {:.2g} rad and a lag below {:.2g} s are not traced",
      voltage.doubt, how, voltage.open_e / facts_.machine.n_p, voltage.open_s));
  return std::move(*r);
}

// True if the member acts on the torque equation alone.
bool of_torque(const std::shared_ptr<Effect>& member) {
  return member->tracing().traits().equation == Traits::Equation::kMechanical;
}

// Frees the block of judging rows that may contain a moment of a member: the other rows cannot date
// it in the block, where all moments are equally likely. The block then judges no more, and true is
// returned. A whole file is never freed. `seen`: the chain of the other rows.
bool free_moment(const Chain& seen, const Record& record, const Members& members,
                 std::vector<char>& judging) {
  constexpr double kMost = 0.5;     // of the judging rows: the others must suffice to judge
  constexpr double kSurely = 10.8;  // rise of the error at a wrong moment, p = 0.001
  const auto n = static_cast<std::ptrdiff_t>(judging.size());
  const auto reach = static_cast<std::ptrdiff_t>(std::ceil(kReach_s / record.T_s));
  const auto judges = [&](std::ptrdiff_t k) { return judging[static_cast<std::size_t>(k)] != 0; };
  const auto all = std::count(judging.begin(), judging.end(), char{1});
  if (std::none_of(members.begin(), members.end(),
                   [](const auto& member) { return has_key(*member, "time_s"); }))
    return false;
  const Rows none, every = Rows::where(seen.sampler(), [](std::size_t) { return true; });
  const Fitter fitter(seen, every, none);
  for (std::size_t m = 0; m < members.size(); ++m) {
    if (!has_key(*members[m], "time_s")) continue;
    const auto at = std::min(
        n - 1, std::lower_bound(record.t.begin(), record.t.end(), get_key(*members[m], "time_s")) -
                   record.t.begin());
    const double rss = fitter.start(members).rss;
    for (const int way : {1, -1}) {
      std::ptrdiff_t edge = at;
      while (edge >= 0 && edge < n && !judges(edge)) edge += way;
      if (edge < 0 || edge >= n) continue;
      if (std::abs(edge - at) > reach) {
        Members there = with(members, nullptr);
        set_key(*there[m], "time_s", record.t[static_cast<std::size_t>(edge)]);
        if (!there[m]->prepare(seen.equations().facts()).empty() ||
            fitter.start(std::move(there)).rss > rss + kSurely)
          continue;
      }
      std::ptrdiff_t first = edge, end = edge;
      while (first > 0 && judges(first - 1)) --first;
      while (end < n && judges(end)) ++end;
      if (static_cast<double>(end - first) > kMost * static_cast<double>(all)) continue;
      std::fill(judging.begin() + first, judging.begin() + end, char{0});
      return true;
    }
  }
  return false;
}

TraceResult Tracing::trace_rows(const Readable& log, std::vector<char> judging, bool given) {
  const Record& raw = log.changed ? *log.changed : log_;
  const double of_zero = zero_in_doubt(raw.angle, drive_.sensors.encoder_counts);
  const bool rounding_unknown = drive_.sensors.encoder_counts == 0 && raw.angle.centre > 0;
  if (rounding_unknown)
    if (const double back = rounding_to_nearest(raw, facts_, known_); back != 0) {
      TraceResult nearest =
          from_zero(back, "theta_m was rounded to the nearest count, and is used as it stands",
                    judging, given);
      // An offset within a count is left, so it was not.
      if (zero_within(of_zero, nearest) == 0) return nearest;
    }
  BusRipple bus = find_bus_ripple(raw, judging, facts_, known_, settings_.considered);
  const std::optional<Record> applied = as_bus_acted(raw, bus);
  const Record& whole = applied ? *applied : raw;
  laps_("bus voltage");
  DriveProblem problem(whole, judging, facts_, known_, settings_.considered, health_.i_lsb);
  problem.stop_when(settings_.stop);
  laps_("equations");
  Search search(problem, margin_of(problem.seen().equations().record(), health_, facts_),
                settings_.say);
  const JudgedFiles files = judged_files(settings_.files, whole, problem.rows());
  Findings f;
  try {
    f = found(problem, search, files, log.voltage);
    const bool blocks_judge = std::none_of(settings_.files.begin(), settings_.files.end(),
                                           [](const SourceRows& file) { return file.held_out; });
    if (blocks_judge && freed_ < kMostFreed &&
        free_moment(problem.seen(), whole, f.selection.fit.members, judging)) {
      ++freed_;
      return trace_rows(log, std::move(judging), given);
    }
  } catch (const TraceStopped&) {
    f.selection = search.so_far();
    f.passed = not_asked(f.selection);
  }
  // The remaining steps are short, and the findings so far are reported.
  problem.stop_when({});
  tell_refused(f.passed.refused);
  const Passed passed = f.passed;
  const Selection selection =
      f.selection.stopped_after
          ? std::move(f.selection)
          : what_passed(search.fitter(), search.dictionary().whitened, std::move(f));
  laps_("gate");
  const Members& members = passed.fit.members;
  const auto any = [](std::size_t) { return true; };
  const Sampler& of_all = problem.all().sampler();
  const Rows none, not_judging = Rows::where(problem.seen().sampler(), any),
                   last_fits = settings_.fit_judging_rows || !given ? Rows::where(of_all, any)
                                                                    : Rows(of_all, false);
  const Fitter seen(problem.seen(), not_judging, none), last(problem.all(), last_fits, none);
  Fit fitted = members.empty() ? last.start({}) : last.refine(members, Fitter::Until::kArrived);
  if (!fitted.valid) fitted = last.linearised(with(members, nullptr));
  // Single ticks scatter by more than the sensors do, so the residual voltage is of no use.
  if (log.voltage.of_tick && !selection.stopped_after &&
      std::all_of(members.begin(), members.end(), of_torque)) {
    TraceResult of_torque_alone = without_voltage(
        log.voltage.told + "; nothing was shown with it: no electrical effect is traced",
        std::move(judging), given);
    doubt_beside_refused(passed.refused, of_torque_alone);
    return of_torque_alone;
  }
  TraceResult result = conclude({.rounds = search.fitter(),
                                 .seen = seen,
                                 .last = last,
                                 .dictionary = search.dictionary(),
                                 .selection = selection,
                                 .passed = passed,
                                 .fitted = fitted,
                                 .files = files,
                                 .health = health_,
                                 .bus = bus,
                                 .lag_is_open = log.voltage.open_s > 0});
  if (const double by = zero_within(of_zero, result); by != 0)
    return from_zero(
        by,
        fmt::format("the zero of theta_m was moved by {:.2g} of a count, {:.3g} rad: no "
                    "encoder_offset of that size is told from the place of a reading "
                    "within its count",
                    by / raw.angle.lsb, by),
        judging, given);
  for (const std::string& line : {log.voltage.told, log.fast})
    if (!line.empty()) result.health.push_back(line);
  laps_("conclusions");
  result.judging = std::move(judging);
  return result;
}

}  // namespace

TraceResult trace_record(const Record& record, const DriveConfig& drive, const Health& health,
                         const TraceSettings& settings, std::vector<char> held_out) {
  const auto begin = std::chrono::steady_clock::now();
  TraceResult r = Tracing(record, drive, health, settings)(std::move(held_out));
  r.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  tell_excluded(settings.considered, r);
  return r;
}

}  // namespace twinrate
