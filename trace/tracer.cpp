#include "trace/tracer.hpp"

#include <fmt/format.h>

#include <chrono>
#include <cmath>
#include <optional>

#include "model/effects/materiality.hpp"
#include "trace/angle_zero.hpp"
#include "trace/bus_applied.hpp"
#include "trace/conclude.hpp"
#include "trace/consistency.hpp"
#include "trace/gate.hpp"
#include "trace/noise.hpp"
#include "trace/signals.hpp"
#include "trace/slips.hpp"
#include "trace/thinning.hpp"
#include "trace/voltage_meaning.hpp"

namespace twinrate {
namespace {

constexpr double kSlowest = 0.15;  // rad/s: below it friction is not what the speed says
constexpr double kCoarseMargin = 650;
constexpr double kLost = 0.01;  // share of lost rows that doubles the margin
constexpr int kMostRounds = 8;  // of noise model and selection, an effect each
constexpr double kSame = 0.9;   // a noise level that fell by less is the same

double ms_since(std::chrono::steady_clock::time_point t) {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - t).count();
}

// Product of the channels' innovations.
double level(const NoiseModel& noise) {
  double product = 1;
  for (const Whitener* w : {&noise.d, &noise.q, &noise.torque})
    if (w->sigma() > 0) product *= w->sigma();
  return product;
}

bool same_scales(const NoiseModel& a, const NoiseModel& b) {
  constexpr double kSameScale = 0.1;
  const auto same = [](double x, double y) { return std::abs(x / y - 1) < kSameScale; };
  return same(a.scale_d, b.scale_d) && same(a.scale_q, b.scale_q) &&
         same(a.scale_torque, b.scale_torque);
}

// What has been found makes the sensors' noise far louder than the whitening takes it for: a dead
// time does where currents are small, on an axis where nothing showed of it before.
bool louder(const Chain& chain, const Sampled& y) {
  constexpr double kTimes = 2;  // in power
  const Sampled w = chain.whitened(y);
  const auto power = [](const Eigen::VectorXd& noise) {
    return noise.squaredNorm() / std::max(1.0, static_cast<double>(noise.size()));
  };
  return std::max(power(w.noise_d), power(w.noise_q)) > kTimes;
}

// 0 where the currents go over many steps of the converter, 1 where over two (rms).
double few_steps(const Record& record, double i_lsb) {
  constexpr double kLeast = 1.0 / 16;
  double sum = 0;
  for (const Vec2& i : record.i_alphabeta) sum += i.squaredNorm();
  const double rows = static_cast<double>(std::max<std::size_t>(1, record.i_alphabeta.size()));
  return 4 * i_lsb * i_lsb / std::max(sum / rows, kLeast * i_lsb * i_lsb);
}

}  // namespace

std::vector<char> moving_rows(const Record& record) {
  std::vector<char> ok = record.motion_ok;
  const std::vector<double> omega_m = smooth_rate(record.theta_m, record.T_s, record.rows_each);
  for (std::size_t k = 0; k < ok.size(); ++k) ok[k] = ok[k] && std::abs(omega_m[k]) > kSlowest;
  return ok;
}

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

// Size that an effect must have beyond what is open of the voltage's frame and moment.
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

// Most rows have a current of fewer than two steps.
bool mostly_few_steps(const Record& record, double i_lsb) {
  const auto few =
      std::count_if(record.i_alphabeta.begin(), record.i_alphabeta.end(),
                    [&](const Vec2& i) { return i.squaredNorm() < 4 * i_lsb * i_lsb; });
  return 2 * static_cast<std::size_t>(few) > record.i_alphabeta.size();
}

// Size, that of a constant torque, which half a step of a current sensor makes: where the current takes few
// steps, that much is missing of it as long as it stays.
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

// Kinds of claims that cannot be what is there.
std::vector<std::string> wrong_kinds(const std::vector<Refused>& refused) {
  std::vector<std::string> kinds;
  for (const Refused& r : refused)
    if (r.wrong_kind) kinds.push_back(r.kind);
  return kinds;
}

// Kinds that no machine can have so large: no other names of what passed.
std::vector<std::string> impossible_kinds(const std::vector<Refused>& refused) {
  std::vector<std::string> kinds;
  for (const Refused& r : refused)
    if (r.rule == "physical") kinds.push_back(r.kind);
  return kinds;
}

// What passed, as the selection judged it: judged anew where others were refused beside it, for
// what could stand in their places is another then.
Selection what_passed(const Fitter& fitter, const std::vector<Candidate>& candidates,
                      Selection selection, const Passed& passed) {
  const bool all = passed.kept.size() == selection.members.size();
  if (all && wrong_kinds(passed.refused).empty()) return selection;
  Members members;
  for (std::size_t m : passed.kept) members.push_back(selection.fit.members[m]->clone());
  Selection anew = compare_alternatives(fitter, candidates, members);
  anew.refused = std::move(selection.refused);
  return anew;
}

// Every member passes, as where nobody judged.
Passed not_asked(const Selection& selection) {
  Passed passed{.fit = selection.fit, .kept = {}, .judgements = {}, .refused = {}};
  for (std::size_t m = 0; m < selection.members.size(); ++m) {
    passed.kept.push_back(m);
    passed.judgements.push_back({.held_out_gain = selection.members[m].held_out_gain});
  }
  return passed;
}

// The voltage equation takes the currents between two rows for a cubic in rotor axes. Of a vector that
// turns by 1 rad that is right to 0.2 %: a row further from the last one has no voltage equation.
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

TraceResult trace_considered(const Record& log, const DriveConfig& drive, const Health& health,
                             const TraceSettings& settings, std::vector<char> held_out) {
  const auto begin = std::chrono::steady_clock::now();
  if (!health.blind.empty()) {
    TraceResult r;
    r.verdict = "ambiguous";
    r.sentence = "Cannot tell: " + health.blind + ".";
    r.health = health.lines();
    return r;
  }
  if (auto found = inconsistencies(log, health, drive.facts(), drive.sensors.encoder_counts);
      !found.empty())
    return inconsistent_result(std::move(found), health);
  const auto without_voltage = [&](std::string why) {
    Record rest = log;
    rest.u_alphabeta.clear();
    TraceResult r = trace_considered(rest, drive, health, settings, std::move(held_out));
    r.health.push_back(std::move(why));
    return r;
  };
  VoltageMeaning voltage = voltage_meaning(log, drive.facts());
  if (!voltage.doubt.empty()) return without_voltage(std::move(voltage.doubt));
  std::optional<Record> turned;
  std::string fast;
  if (voltage.of_tick) turned = with_mean_of_ticks(log, drive.facts());
  if (const std::size_t rows = fast_rows(log, drive.machine.n_p); rows > 0) {
    fast = fmt::format(
        "{:.0f} % of the rows: the rotor turns by more than {} rad electrical up to the next",
        100. * static_cast<double>(rows) / static_cast<double>(log.size()), kMostTurn);
    if (log.size() - rows < kFewestRows)
      return without_voltage(fast + ": no electrical effect is traced. Log more rows a second");
    fast += ": they have no voltage equation";
    if (!turned) turned = log;
    leave_out_fast_rows(*turned, drive.machine.n_p);
  }
  const Record& raw = turned ? *turned : log;
  const bool fit_judging_rows = settings.fit_judging_rows || held_out.empty();
  if (held_out.empty()) held_out = held_out_rows(raw, settings.holdout, drive.machine.n_p);
  auto t0 = std::chrono::steady_clock::now();
  const Effects known = drive.model_effects();
  const DriveFacts facts = drive.facts();
  const bool rounding_unknown = drive.sensors.encoder_counts == 0 && raw.angle.centre > 0;
  const auto from_zero = [&](double by, const char* why) {
    TraceSettings same = settings;
    same.fit_judging_rows = fit_judging_rows;
    TraceResult r = trace_considered(moved(log, by), drive, health, same, held_out);
    r.health.emplace_back(why);
    return r;
  };
  if (rounding_unknown)
    if (const double back = rounding_to_nearest(raw, facts, known); back != 0)
      return from_zero(back, "theta_m was rounded to the nearest count, and is used as it stands");
  const auto lap = [&](const char* what) {
    if (settings.say) settings.say(fmt::format("{}: {:.0f} ms", what, ms_since(t0)));
    t0 = std::chrono::steady_clock::now();
  };
  BusRipple bus = find_bus_ripple(raw, held_out, facts, known, settings.considered);
  Effects on_bus = known;
  if (!bus.own_clocks)
    for (const TracedEffect& e : bus.effects) on_bus.push_back(e.effect);
  std::optional<Record> applied;
  if (!acting_on(on_bus, kOnBus).empty()) applied = as_applied(raw, on_bus);
  if (applied && !acted(raw, *applied, facts.machine)) {
    applied->u_alphabeta = raw.u_alphabeta;
    bus.notes.push_back(
        "the logged voltage already contains the ripple of v_dc and is used unchanged");
  }
  const Record& whole = applied ? *applied : raw;
  lap("bus voltage");
  const std::vector<char> choosing = choosing_rows(whole, held_out, facts.machine.n_p);
  Record seen = whole;  // without the rows that judge
  hide(held_out, seen);
  const NoisierRecords noisier = add_noise(seen, facts, moving_rows(seen), health.i_lsb);
  const std::size_t rows = rows_as_one(whole.T_s);
  const auto thin = [&](const Record& r) { return thinned(r, rows, facts.machine.n_p); };
  const Record record = thin(seen), record_answered = thin(noisier.answered),
               record_readings = thin(noisier.readings);
  const Equations equations(record, facts, known, settings.considered),
      answered(record_answered, facts, known), readings(record_readings, facts, known);
  const Sampler sampler(record, moving_rows(record), thinned(choosing, whole, rows));
  Chain chain(equations, answered, readings, sampler);
  chain.stop_when(settings.stop);
  const auto moved_counts = [&] { return thin(with_moved_counts(seen)); };
  if (seen.angle.lsb > 0) chain.set_moved_counts(moved_counts);
  lap("equations");
  Dictionary dictionary{.sampled = make_candidates(chain), .whitened = {}};
  lap("candidates");
  const Rows training(sampler, false), unseen(sampler, true);
  Fit fit;                  // after the last whole round
  NoiseModel noise_of_fit;  // that it was made under
  NoiseFit fit_noise;
  RoundState state;
  std::vector<std::string> left_out;  // kinds that the gate refused as another than what is there
  int rounds = 0;
  // The error of a coarse ADC is no noise: it repeats with the current, the more so the fewer steps
  // that takes. Nor is that of filling rows that were lost.
  const double margin = health.coarse(facts.machine.i_rated)
                            ? kCoarseMargin * (1 + few_steps(record, health.i_lsb))
                            : Fitter::kMargin * (1 + health.not_read() / kLost);
  const auto fitter = [&] {
    Fitter f(chain, training, unseen);
    f.set_margin(margin);
    f.leave_out(left_out);
    return f;
  };
  Selection selection;
  const auto select = [&] {
    const int first = rounds;
    state = {};
    for (; state.added && rounds < first + kMostRounds; ++rounds) {
      const Effects so_far = fit.effects();
      const bool renewed = dictionary.renew(chain, so_far);
      const Sampled left = chain.residual(so_far);
      NoiseModel noise = fit_noise(chain, left, dictionary);
      const bool anew =
          rounds == first || level(noise) < kSame * level(chain.noise()) || louder(chain, left);
      // How much of it is the sensors', beside what has been found: a dead time amplifies theirs.
      const bool other = !anew && !same_scales(noise, chain.noise());
      if (anew) {
        chain.set_noise(std::move(noise));
      } else if (other) {
        NoiseModel scaled = chain.noise();
        scaled.scale_d = noise.scale_d;
        scaled.scale_q = noise.scale_q;
        scaled.scale_torque = noise.scale_torque;
        chain.set_noise(std::move(scaled));
      }
      if (anew || renewed || other) dictionary.whiten(chain, !anew && !other);
      if (anew && settings.say)
        settings.say(fmt::format("noise {:.4g} {:.4g} V, {:.4g} Nm", chain.noise().d.rms(),
                                 chain.noise().q.rms(), chain.noise().torque.rms()));
      lap("noise");
      fit = select_one(fitter(), dictionary.whitened, fit.members, settings.say, state);
      noise_of_fit = chain.noise();
      lap("selection");
    }
    selection = judge(fitter(), dictionary.whitened, fit.members, settings.say);
    lap("judgement");
  };
  const auto stopped = [&] {
    chain.stop_when({});
    selection = not_judged(std::move(fit), rounds);
  };
  try {
    select();
  } catch (const TraceStopped&) {
    if (rounds == 0) throw;
    chain.set_noise(std::move(noise_of_fit));
    stopped();
  }
  const Record all_rows = thin(whole);
  const Sampler sampler_of_all(all_rows, moving_rows(all_rows), thinned(held_out, whole, rows));
  Chain chain_of_all(equations, answered, readings, sampler_of_all);
  if (!selection.stopped_after) chain_of_all.stop_when(settings.stop);
  chain_of_all.set_noise(chain.noise());
  if (seen.angle.lsb > 0) chain_of_all.set_moved_counts(moved_counts);
  if (seen.angle.lsb > 0) chain.set_moved_counts([&] { return thin(with_moved_counts(seen)); });
  const auto any = [](std::size_t) { return true; };
  const Rows none, not_judging = Rows::where(sampler, any),
                   judged_too = Rows::where(sampler_of_all, any), judging(sampler_of_all, true),
                   without_judging(sampler_of_all, false);
  const Fitter seen_fitter(chain, not_judging, none);
  const JudgedFiles files = judged_files(settings.files, whole, rows);
  Passed passed = not_asked(selection);
  if (!selection.stopped_after && judging.electrical() + judging.torque() > 0) {
    Gate gate(seen_fitter, chain_of_all, files);
    gate.set_resolution([&](const Effect& effect) {
      return std::max(least_beside(voltage, effect, facts),
                      least_beside_steps(record, health, effect, facts));
    });
    std::optional<std::vector<Gate::Doubt>> doubts;
    gate.set_doubts([&] {
      if (!doubts) doubts = doubts_of(log, facts);
      return *doubts;
    });
    std::optional<HalfRate> half;
    gate.set_half_rate([&]() -> const HalfRate& {
      if (!half)
        half.emplace(whole, noisier, 2 * rows, facts, known, passed.fit.effects(), chain.noise());
      return *half;
    });
    // What a claim explains that cannot be there is something else: once more without such kinds. Others
    // that explain far less of it are not what is there.
    const auto without_wrong_kinds = [&] {
      const Selection first = selection;
      const Passed refused = passed;
      const NoiseModel noise_before = chain.noise();
      half.reset();
      fit = passed.fit;
      select();
      chain_of_all.set_noise(chain.noise());
      passed = not_asked(selection);
      passed = gate(selection.fit.members);
      // Under the noise of the first model: what it explained is noise to the second.
      const NoiseModel noise_after = chain.noise();
      chain.set_noise(noise_before);
      chain_of_all.set_noise(noise_before);
      if (passed.kept.size() <= refused.kept.size() ||
          !explains_as_much(seen_fitter, refused.fit.members, first.fit.members,
                            passed.fit.members)) {
        selection = first;
        passed = refused;
        return;
      }
      chain.set_noise(noise_after);
      chain_of_all.set_noise(noise_after);
      passed.refused.insert(passed.refused.begin(), refused.refused.begin(), refused.refused.end());
    };
    try {
      passed = gate(selection.fit.members);
      left_out = wrong_kinds(passed.refused);
      if (!left_out.empty()) without_wrong_kinds();
    } catch (const TraceStopped&) {
      chain_of_all.stop_when({});
      stopped();
      passed = not_asked(selection);
    }
    left_out = impossible_kinds(passed.refused);
    if (settings.say)
      for (const Refused& r : passed.refused)
        settings.say(fmt::format("  {} refused: {}{}{}, {}", r.kind, r.rule,
                                 r.file.empty() ? "" : ", ", r.file, r.text));
    selection = what_passed(fitter(), dictionary.whitened, std::move(selection), passed);
  }
  lap("gate");
  chain.stop_when({});  // what is left is short, and what has been found is written
  chain_of_all.stop_when({});
  const Fitter last(chain_of_all, fit_judging_rows ? judged_too : without_judging, none);
  Fit fitted = passed.fit.members.empty()
                   ? last.start({})
                   : last.refine(passed.fit.members, Fitter::Until::kArrived);
  if (!fitted.valid) fitted = last.linearised(with(passed.fit.members, nullptr));
  // Single ticks scatter by more than the sensors do: what is left of the voltage says nothing.
  const auto of_torque = [](const auto& member) {
    return member->tracing().traits().equation == Traits::Equation::kMechanical;
  };
  if (voltage.of_tick && !selection.stopped_after &&
      std::all_of(passed.fit.members.begin(), passed.fit.members.end(), of_torque))
    return without_voltage(voltage.told +
                           "; nothing was shown with it: no electrical effect is traced");
  TraceResult result = conclude({.rounds = fitter(),
                                 .seen = seen_fitter,
                                 .last = last,
                                 .dictionary = dictionary,
                                 .selection = selection,
                                 .passed = passed,
                                 .fitted = fitted,
                                 .files = files,
                                 .health = health,
                                 .bus = bus});
  if (const double by = rounding_unknown ? zero_within_count(result, raw.angle) : 0; by != 0)
    return from_zero(by, "the zero of theta_m was moved within a count");
  if (!voltage.told.empty()) result.health.push_back(std::move(voltage.told));
  if (!fast.empty()) result.health.push_back(std::move(fast));
  lap("conclusions");
  result.seconds = 1e-3 * ms_since(begin);
  return result;
}

}  // namespace

TraceResult trace_record(const Record& record, const DriveConfig& drive, const Health& health,
                         const TraceSettings& settings, std::vector<char> held_out) {
  TraceResult r = trace_considered(record, drive, health, settings, std::move(held_out));
  tell_excluded(settings.considered, r);
  return r;
}

}  // namespace twinrate
