#include "trace/gate.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <set>

#include "model/effects/catalogue.hpp"
#include "model/effects/tracing.hpp"
#include "trace/agreement.hpp"
#include "trace/another_machine.hpp"
#include "trace/doubts.hpp"
#include "trace/keys.hpp"
#include "trace/speed_law.hpp"
#include "trace/steps_at_reversals.hpp"
#include "trace/vote.hpp"

namespace twinrate {
namespace {

constexpr double kDrawn = 1.5;  // factor of energy: the drawn noise is known to about a third
// The controller responds to noise late, and its drawn response has another delay. Without a true
// lag the rows have 3.6 to 20,000 times the energy of the noise (nine drawn logs), without a false
// one 1.4 to 2.5 times (five).
constexpr double kOfLag = 3;
// Share of a claim's change that a scale could explain. By design: a constant load has 1, a torque
// that is periodic in the angle has 0.
constexpr double kSteady = 0.5;

// Share of the fall of the torque's energy that comes from outputs around which the speed changes,
// less the part that a lighter motor makes of the sensors' noise there.
double fall_in_motion(const Chain& whole, const JudgingRows& judging, const Sampled& with,
                      const Sampled& without) {
  constexpr double kTimes = 2;  // factor of energy to which the drawn noise is known
  if (!without.torque.size()) return 0;
  const std::vector<char> changes = changing_speed(whole.equations(), whole.sampler().torque());
  const auto energy = [&](const Eigen::VectorXd& torque, bool all) {
    Sampled y;
    y.torque = torque;
    for (std::size_t i = 0; i < changes.size() && !all; ++i)
      if (!changes[i]) y.torque[static_cast<Eigen::Index>(i)] = 0;
    return judging.energy(y, &Sampled::torque);
  };
  const double all = energy(without.torque, true) - energy(with.torque, true);
  if (all <= 0) return 0;
  const double was = energy(without.torque, false), is = energy(with.torque, false);
  double quieter = 0;
  if (without.noise_torque.size() && with.noise_torque.size()) {
    const double noise_was = energy(without.noise_torque, false),
                 noise_is = energy(with.noise_torque, false);
    if (noise_was > noise_is)
      quieter = std::min(was, kTimes * noise_was) * (1 - noise_is / noise_was);
  }
  return (was - is - quieter) / all;
}

// The fall of the voltage's error by a claim.
struct VoltageFall {
  double in_motion = 1;  // the part from outputs around which the speed changes, over its size
  double of_noise = 1;   // over the energy of the sensors' noise
};

VoltageFall voltage_fall(const Chain& whole, const JudgingRows& judging, const Sampled& with,
                         const Sampled& without) {
  const std::vector<char> changes = changing_speed(whole.equations(), whole.sampler().electrical());
  double all = 0, moving = 0, noise = 0;
  for (const auto& [channel, noise_of] :
       {std::pair(&Sampled::d, &Sampled::noise_d), std::pair(&Sampled::q, &Sampled::noise_q)}) {
    const auto energy = [&, channel = channel](const Eigen::VectorXd& y, bool everywhere) {
      Sampled of;
      of.*channel = y;
      for (std::size_t i = 0; i < changes.size() && !everywhere; ++i)
        if (!changes[i]) (of.*channel)[static_cast<Eigen::Index>(i)] = 0;
      return judging.energy(of, channel);
    };
    all += energy(without.*channel, true) - energy(with.*channel, true);
    moving += energy(without.*channel, false) - energy(with.*channel, false);
    noise += energy(with.*noise_of, true);
  }
  return {.in_motion = moving / std::abs(all), .of_noise = all / noise};
}

// False for a claim that the voltage shows, with a gain of at most a tenth (by design) in the torque.
bool rests_on_torque(const Vote& vote) {
  constexpr double kLittle = 0.1;
  return vote.of_torque && (!vote.of_voltage || vote.torque_share > kLittle);
}

// True for a kind that is a line at constant speed.
bool is_line(const Effect& effect) {
  const Traits::Period::In in = effect.tracing().traits().period.in;
  return in != Traits::Period::kUnstated && in != Traits::Period::kNothing;
}

// True at constant speed if the counts of the angle were not found, and half of the coarsest that are
// not looked for would make a third of the voltage's error or more.
bool unseen_counts_matter(const Chain& whole, const Fit& without) {
  constexpr double kHalfCount = kPi / (1 << 18), kPart = 1.0 / 3;
  const Equations& equations = whole.equations();
  if (equations.record().angle.lsb > 0 || !at_constant_speed(equations)) return false;
  const Sampled error = whole.residual(without.effects());
  double omega_2 = 0;
  for (const std::size_t row : whole.sampler().electrical().row)
    omega_2 += std::pow(equations.points()[row].omega_m, 2);
  const MachineParameters& m = equations.facts().machine;
  const double per_rad_s = m.n_p * kHalfCount * m.n_p * m.psi_f;
  return per_rad_s * per_rad_s * omega_2 >
         kPart * kPart * (error.d.squaredNorm() + error.q.squaredNorm()) / 2;
}

// The fall of the energy of the voltage and of the torque, on the judging rows.
std::array<double, 2> fall_by(const JudgingRows& judging, const Sampled& with,
                              const Sampled& without) {
  const std::array<double, 2> was = judging.energies(without), is = judging.energies(with);
  return {was[0] - is[0], was[1] - is[1]};
}

// The fall of the error by one claim, over the largest fall by another in the same equation (rms).
double beside_largest(const std::vector<std::array<double, 2>>& falls, std::size_t claim) {
  constexpr double kAlone = std::numeric_limits<double>::infinity();
  double most = 0;
  for (std::size_t equation : {0, 1}) {
    double largest = 0;
    for (std::size_t m = 0; m < falls.size(); ++m)
      if (m != claim) largest = std::max(largest, falls[m][equation]);
    const double fall = std::max(0.0, falls[claim][equation]);
    if (fall > 0) most = std::max(most, largest > 0 ? std::sqrt(fall / largest) : kAlone);
  }
  return most;
}

}  // namespace

struct Gate::Asked {
  Fit fit;
  Sampled with;
  std::vector<Fit> without_fit;
  std::vector<Vote> votes;
  std::vector<double> in_motion;  // share of the fall where the speed changes; 0 if not asked
  std::vector<VoltageFall> falls;
  std::vector<std::array<double, 2>> falls_by;  // of the energy of the voltage and of the torque
};

Gate::Asked Gate::ask(const Fit& fit) const {
  Asked asked;
  asked.fit = fit;
  const auto left_by = [&](const Fit& f) { return whole_.residual(f.effects()); };
  const Sampled raw = left_by(fit);
  asked.with = whole_.whitened(raw);
  const JudgingRows judging(whole_, files_);
  const MachineParameters& machine = whole_.equations().facts().machine;
  const double T_s = whole_.sampler().decimation() * whole_.equations().record().T_s;
  // A slope of some 30 Ohm around zero current amplifies any noise, so the comparisons with noise
  // are left out there.
  const Effects& known = whole_.equations().known();
  const auto at_zero = [](const auto& effect) { return turns_at_zero(*effect); };
  const bool through_zone = std::any_of(fit.members.begin(), fit.members.end(), at_zero) ||
                            std::any_of(known.begin(), known.end(), at_zero);
  for (std::size_t m = 0; m < fit.members.size(); ++m) {
    Fit without = seen_.refine(with(fit.members, nullptr, m));
    const Sampled raw_without = left_by(without);
    // A lighter motor reduces the noise at every frequency, and a noise model of the residual holds
    // part of a resonance. So such a claim is compared in the sensors' own noise.
    const bool in_sensors = changes_inertia(*fit.members[m]) && raw.torque.size() > 0 &&
                            is_lighter(fit.members, without.members, machine);
    const Sampled white = whole_.whitened(raw_without);
    asked.falls_by.push_back(in_sensors ? std::array<double, 2>{}
                                        : fall_by(judging, asked.with, white));
    const Sampled with = in_sensors ? whole_.in_sensors(raw) : asked.with,
                  left = in_sensors ? whole_.in_sensors(raw_without) : white;
    const auto fall = [&](const Sampled& is, const Sampled& was) {
      return fall_of_angle_error(fit.members, is.torque, without.members, was.torque, machine,
                                 whole_.sampler().torque(), T_s);
    };
    AngleErrorFall angle;
    if (white.torque.size()) {
      angle = fall(with, left);
      // A spectrum that falls by decades leaks from one frequency to the others.
      if (in_sensors) angle.log_ratio = fall(asked.with, white).log_ratio;
    }
    asked.votes.push_back(vote(judging, with, left, angle, *fit.members[m], through_zone,
                               in_sensors, criterion_.silent));
    asked.in_motion.push_back(
        is_shaft(*fit.members[m]) ? fall_in_motion(whole_, judging, with, left) : 0);
    Vote& newest = asked.votes.back();
    asked.falls.push_back(newest.of_voltage && rounded_ && is_line(*fit.members[m])
                              ? voltage_fall(whole_, judging, raw, raw_without)
                              : VoltageFall{});
    if (is_of(*fit.members[m], Traits::Family::kLag)) {
      newest.least_over_noise = kOfLag;
      newest.least_because = "the controller responds to the noise with a delay";
    } else if (in_sensors && newest.of_torque) {
      newest.least_over_noise = kDrawn;
      newest.least_because = "a lighter motor makes that noise smaller, and its size is drawn";
    }
    asked.without_fit.push_back(std::move(without));
  }
  return asked;
}

// Step of the log's load at the moment of a load step, Nm.
double step_of_known_load(const Record& record, const Effect& effect) {
  if (record.T_load.empty() || !has_key(effect, "time_s") || !has_key(effect, "torque_Nm"))
    return 0;
  const auto n = static_cast<std::ptrdiff_t>(record.size());
  const auto at = std::lower_bound(record.t.begin(), record.t.end(), get_key(effect, "time_s")) -
                  record.t.begin();
  const auto reach = static_cast<std::ptrdiff_t>(std::ceil(kReach_s / record.T_s)) + 1;
  const auto load = [&](std::ptrdiff_t k) {
    return record.T_load[static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(k, 0, n - 1))];
  };
  return std::abs(load(at + reach) - load(at - reach));
}

// One for each member; its rule is empty if the member passes. The rules are tested in the order of
// their cost.
std::vector<Refused> Gate::refusals(const Asked& asked) const {
  const Members& members = asked.fit.members;
  const DriveFacts& facts = whole_.equations().facts();
  std::vector<Refused> out(members.size());
  const auto refuse = [&](std::size_t m, const char* rule, const std::string& file, double number,
                          std::string text) {
    if (out[m].rule.empty())
      out[m] = {.kind = std::string(members[m]->kind()),
                .rule = rule,
                .file = file,
                .number = number,
                .text = std::move(text)};
  };
  for (std::size_t m = 0; m < members.size(); ++m) {
    double share = 0;
    if (std::string why = another_machine(*members[m], facts, share); !why.empty())
      refuse(m, "physical", "", share, std::move(why));
  }
  // An error of a known load, or of the torque constant under it, begins at a step of that load.
  for (std::size_t m = 0; m < members.size(); ++m) {
    const double known_Nm = step_of_known_load(whole_.equations().record(), *members[m]);
    if (known_Nm == 0 || known_Nm < std::abs(get_key(*members[m], "torque_Nm"))) continue;
    refuse(m, "physical", "", known_Nm,
           fmt::format("the load of the log steps by {:.3g} Nm at that moment: an error of it, "
                       "or of the torque constant, looks the same",
                       known_Nm));
    out[m].wrong_kind = true;
  }
  for (std::size_t m = 0; m < members.size(); ++m) {
    const double size = members[m]->tracing().materiality(facts);
    if (size < 1)
      refuse(m, "size", "", size,
             fmt::format("{:.2g} times the smallest size worth reporting", size));
    if (resolution_)
      if (const double least = resolution_(*members[m]); size < least)
        refuse(m, "sensors", "", size / least,
               fmt::format("{:.2g} times the size that the sensors and the rate of the log resolve",
                           size / least));
  }
  // No model of an effect is that exact. Of 626 claims of foreign and drawn logs beside another in
  // the same equation, the smallest true one has 0.0068, and two false ones have 0.0015 and 0.0017.
  constexpr double kExact = 0.003;
  for (std::size_t m = 0; m < members.size(); ++m)
    if (const double part = beside_largest(asked.falls_by, m); part > 0 && part < kExact)
      refuse(m, "size", "", part,
             fmt::format("it explains {:.2g} of what another effect explains: no model of an "
                         "effect is that exact",
                         part));
  std::vector<std::string> paths;
  for (const JudgedFile& file : files_.files) paths.push_back(file.path);
  std::vector<Refused> transfer =
      refused_by_transfer({asked.votes.begin(), asked.votes.end()}, paths, criterion_);
  for (std::size_t m = 0; m < members.size(); ++m)
    if (out[m].rule.empty() && !transfer[m].rule.empty()) {
      out[m] = std::move(transfer[m]);
      out[m].kind = std::string(members[m]->kind());
    }
  if (std::all_of(out.begin(), out.end(), [](const Refused& r) { return !r.rule.empty(); }))
    return out;
  const Chain* half = half_rate_ ? &half_rate_().chain() : nullptr;
  const Parts parts(whole_, members, half);
  const Eigen::MatrixXd covariance =
      seen_.training().count(asked.fit.y) > 0 && asked.fit.J.size() == asked.fit.free.size()
          ? seen_.robust_covariance(asked.fit)
          : Eigen::MatrixXd();
  for (std::size_t m = 0; m < members.size(); ++m) {
    if (!out[m].rule.empty()) continue;
    const Agreement a = parts.of(m, criterion_.sigmas);
    if (a.kept < criterion_.kept)
      refuse(m, "agreement", "", a.kept,
             fmt::format("{:.2g} of its gain is kept between {}", a.kept, a.between));
    if (a.compared < 2) refuse(m, "agreement", "", a.compared, "no two parts of the data show it");
    if (covariance.size() == 0) continue;
    const std::optional<double> wald = joint_wald(asked.fit, covariance, m);
    if (!wald) continue;
    const double between = 1 - a.size_ratio;  // share of its size
    const double sigmas = 1 / std::hypot(1 / std::sqrt(*wald), between);
    if (sigmas >= criterion_.size_sigmas || !out[m].rule.empty()) continue;
    refuse(m, "size", "", sigmas, fmt::format("{:.2g} standard deviations from zero", sigmas));
    out[m].wrong_kind = true;
  }
  const auto passes = [](const Refused& r) { return r.rule.empty(); };
  // At constant speed the rounding of the counts repeats, and a shaft may fit it. Of 41 drawn logs
  // with counts and a shaft in the result true ones have 0.24 or more, false ones 0.03 or less.
  constexpr double kInMotion = 0.1;
  for (std::size_t m = 0; m < members.size(); ++m)
    if (passes(out[m]) && is_shaft(*members[m]) && whole_.equations().record().angle.lsb > 0 &&
        asked.in_motion[m] < kInMotion)
      refuse(
          m, "sensors", "", asked.in_motion[m],
          fmt::format("{:.2g} of its gain comes from rows whose speed changes: at constant speed "
                      "the rounding of the counts repeats, and a shaft may fit it",
                      std::max(0.0, asked.in_motion[m])));
  // So does the rounding of an encoder whose counts are too fine to be found. A false inductance (2^20
  // counts, 280 a row) had 45 standard deviations of the drawn noise, and 1.4 times its energy.
  constexpr double kNoiseAsWell = 1.5, kFarAlong = 100;
  for (std::size_t m = 0; m < members.size(); ++m)
    if (const Vote& v = asked.votes[m];
        passes(out[m]) && v.of_voltage && v.over_noise < kNoiseAsWell &&
        v.along_beside_noise < kFarAlong && unseen_counts_matter(whole_, asked.without_fit[m]))
      refuse(m, "sensors", "", v.along_beside_noise,
             fmt::format("it is {:.2g} standard deviations of the sensors' noise; {:.0f} are "
                         "required at constant speed, where the errors of the angle repeat",
                         v.along_beside_noise, kFarAlong));
  // Rounding may make a line of the voltage, too. Of the lines in 63 drawn logs with flux harmonics the
  // only false one has 0.0034 of the noise's energy and a negative share in motion; true ones have
  // 0.4 or more of the energy, or a share of 0.3 or more.
  constexpr double kOfNoise = 0.1;
  for (std::size_t m = 0; m < members.size(); ++m)
    if (passes(out[m]) && asked.falls[m].in_motion < kInMotion &&
        asked.falls[m].of_noise < kOfNoise)
      refuse(
          m, "sensors", "", asked.falls[m].of_noise,
          fmt::format("it explains {:.2g} of the energy of the sensors' noise, at constant speed: "
                      "the rounding of counts and currents repeats there, and makes lines",
                      asked.falls[m].of_noise));
  for (std::size_t m : steps_at_reversals(whole_.equations().record(), members)) {
    if (!passes(out[m])) continue;
    refuse(m, "law", "", get_key(*members[m], "time_s"),
           "the load steps at the reversals of the motion, as a friction does");
    out[m].wrong_kind = true;
  }
  if (std::any_of(out.begin(), out.end(), passes))
    if (const auto law = speed_law(seen_, asked.fit))
      for (std::size_t m : law->members)
        refuse(m, "law", "", law->exponent,
               fmt::format(
                   "a torque in proportion to |omega_m|^{:.2g} explains the fitted rows better",
                   law->exponent));
  if (doubts_ && std::any_of(out.begin(), out.end(), passes))
    for (const Doubt& doubt : doubts_())
      for (std::size_t m = 0; m < members.size(); ++m)
        if (((doubt.of_voltage && asked.votes[m].of_voltage) ||
             (doubt.of_torque && rests_on_torque(asked.votes[m]))) &&
            (doubt.of_frame || asked.votes[m].steady_share > kSteady))
          refuse(m, doubt.rule, "", 0, doubt.text);
  return out;
}

// An error of the voltage whose cause is unknown lends a part of itself to a claim. A tick's voltage,
// taken for the mean of a slow row, made an inductance that explained 0.014 of the energy above the
// noise floor and left 3.9 times the floor, beside an offset of the encoder a cross saturation, and
// an offset of the encoder that explained 0.08 and left 2.4 times the floor. Such a voltage, whose
// mean was taken from its ticks, made an asymmetry of the phases that explained 0.098 and left 1.9
// times. A true claim that left 4.1 times the floor explained 0.32; of 300 drawn logs none has a true
// one that left 1.5 to 2 times the floor and explained less than 0.69.
std::optional<Refused> Gate::small_part_refusal(const Asked& asked, std::size_t weakest) const {
  constexpr double kFarOverNoise = 1.5, kSmallPart = 0.1;
  const JudgingRows judging(whole_, files_);
  const auto energy = [&](const Sampled& y) {
    return judging.energy(y, &Sampled::d) + judging.energy(y, &Sampled::q);
  };
  const Sampled with = whole_.residual(asked.fit.effects());
  Sampled of_sensors;
  of_sensors.d = with.noise_d, of_sensors.q = with.noise_q;
  const double before = energy(whole_.residual(asked.without_fit[weakest].effects())),
               after = energy(with), noise = energy(of_sensors);
  if (after < kFarOverNoise * kFarOverNoise * noise) return std::nullopt;
  const double part = std::max(0.0, (before - after) / (before - noise));
  if (part >= kSmallPart) return std::nullopt;
  return Refused{.kind = std::string(asked.fit.members[weakest]->kind()),
                 .rule = "whole",
                 .number = part,
                 .text = fmt::format(
                     "it explains {:.2g} % of the voltage error above the noise floor, and {:.2g} "
                     "times the floor is left: an unknown cause may make the claim",
                     100 * part, std::sqrt(after / noise))};
}

// Compares all accepted claims together with the declared model.
std::optional<Refused> Gate::whole_refusal(const Asked& asked, std::size_t& weakest) const {
  if (asked.fit.members.empty()) return std::nullopt;
  const JudgingRows judging(whole_, files_);
  const Sampled declared = whole_.whitened(whole_.residual({}));
  const auto file_sums = [&](const Sampled& y, bool torque) {
    std::map<int, double> sums;
    for (Channel channel : kSampledChannels)
      if ((channel == &Sampled::torque) == torque) judging.add_energy(y, channel, sums);
    return sums;
  };
  for (const bool torque : {false, true}) {
    weakest = kNobody;
    for (std::size_t m = 0; m < asked.votes.size(); ++m)
      if ((torque ? asked.votes[m].of_torque : asked.votes[m].of_voltage) &&
          (weakest == kNobody || asked.votes[m].mean < asked.votes[weakest].mean))
        weakest = m;
    if (weakest == kNobody) continue;
    const auto was = file_sums(declared, torque), is = file_sums(asked.with, torque);
    for (const auto& [file, before] : was)
      if (const double change = is.at(file) / before - 1; change > criterion_.silent)
        return Refused{
            .kind = std::string(asked.fit.members[weakest]->kind()),
            .rule = "whole",
            .file = files_.files.empty() ? "" : files_.files[static_cast<std::size_t>(file)].path,
            .number = change,
            .text = fmt::format("all effects together raise the error of the {} equation",
                                torque ? "torque" : "voltage")};
    if (torque) continue;
    if (auto refused = small_part_refusal(asked, weakest)) return refused;
  }
  return std::nullopt;
}

// The claim whose contribution differs most between the fit of `all` and the fit of those that
// passed, if it differs by more than `moved`.
std::optional<Refused> Gate::moved_refusal(const Members& all, const Passed& passed,
                                           std::size_t& most) const {
  if (passed.refused.empty()) return std::nullopt;
  const Rows& rows = seen_.training();
  const Sampled nothing = whole_.whitened(whole_.residual({}));
  const auto contribution = [&](const std::shared_ptr<Effect>& effect) {
    Sampled share = nothing;
    add(share, whole_.whitened(whole_.residual({effect})), -1);
    return share;
  };
  double largest = criterion_.moved;
  most = kNobody;
  for (std::size_t m = 0; m < passed.kept.size(); ++m) {
    const Sampled is = contribution(passed.fit.members[m]);
    Sampled moved = contribution(all[passed.kept[m]]);
    add(moved, is, -1);
    const double share = std::sqrt(rows.dot(moved, moved) / rows.dot(is, is));
    if (!(share > largest)) continue;
    largest = share;
    most = m;
  }
  if (most == kNobody) return std::nullopt;
  std::set<std::string> others;
  for (const Refused& r : passed.refused) others.insert(r.kind);
  return Refused{
      .kind = std::string(passed.fit.members[most]->kind()),
      .rule = "alone",
      .number = largest,
      .left = true,
      .text = fmt::format("its contribution changes by {:.2g} of its size without the refused {}",
                          largest, fmt::join(others, ", "))};
}

Passed Gate::operator()(const Members& members) const {
  Passed out;
  for (std::size_t m = 0; m < members.size(); ++m) out.kept.push_back(m);
  const auto fitted = [&](const Members& some) {
    Fit fit = seen_.refine(some, Fitter::Until::kArrived);
    return fit.valid ? fit : seen_.linearised(with(some, nullptr));
  };
  out.fit = fitted(members);
  const Members first = with(out.fit.members, nullptr);
  while (!out.fit.members.empty()) {
    const Asked asked = ask(out.fit);
    const std::vector<Refused> refused = refusals(asked);
    std::size_t drop = kNobody;
    for (std::size_t m = 0; m < refused.size(); ++m)
      if (!refused[m].rule.empty() &&
          (drop == kNobody || asked.votes[m].mean < asked.votes[drop].mean))
        drop = m;
    Refused why = drop == kNobody ? Refused{} : refused[drop];
    why.wrong_kind |= why.rule == "physical" || why.rule == "agreement";
    why.left = why.rule != "size" && why.rule != "sensors" && drop != kNobody &&
               asked.votes[drop].judgement.p_value < criterion_.chance;
    if (drop == kNobody)
      if (const std::optional<Refused> whole = whole_refusal(asked, drop)) why = *whole;
    if (why.rule.empty())
      if (const std::optional<Refused> moved = moved_refusal(first, out, drop)) why = *moved;
    if (why.rule.empty()) {
      for (const Vote& v : asked.votes) out.judgements.push_back(v.judgement);
      return out;
    }
    out.refused.push_back(why);
    out.kept.erase(out.kept.begin() + static_cast<std::ptrdiff_t>(drop));
    out.fit = fitted(with(out.fit.members, nullptr, drop));
  }
  return out;
}

}  // namespace twinrate
