#include "trace/acceptance.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "model/effects/catalogue.hpp"
#include "trace/keys.hpp"
#include "trace/lines.hpp"
#include "trace/placing.hpp"

namespace twinrate {
namespace {

// True if the newcomer is present in the whole record: the disagreement of the record's pieces is
// far less than its size. (The values that fill lost rows in a few fast turns can be fitted, too.)
// Other missing effects also make the pieces disagree, and an effect that acts at a few moments is
// visible in few of them. Then it must remove a good part of the held-out error. Shafts are exempt.
bool everywhere(const Fitter& fitter, const Fit& next, const Fit& now) {
  constexpr double kSigmas = 5, kGoodPart = 0.2;
  ShaftFacts shaft;
  const std::size_t last = next.members.size() - 1;
  return next.members[last]->describe_shaft(shaft) ||
         next.rss_held_out < (1 - kGoodPart) * now.rss_held_out ||
         largest_wald(next, fitter.robust_covariance(next), last) > kSigmas * kSigmas;
}

// Least fall of the held-out error: a share of the energy of the newcomer's change there, which a
// true effect removes completely. (The values that fill lost rows, and the residual of a shaft, can
// be fitted, too.) If there is no change, the held-out blocks do not excite the newcomer and cannot
// refuse it. A newcomer that holds noise must also remove more than the uncertainty of the noise
// that the other members bring.
double least_gain(const Fitter& fitter, const Fit& next, const Fit& now) {
  constexpr double kShare = 0.4, kNothing = 1;
  const Effect& newcomer = *next.members.back();
  const double doubt = holds_noise(newcomer) ? now.doubt : -kNothing;
  ShaftFacts shaft;
  if (newcomer.describe_shaft(shaft)) return doubt;
  Sampled change;
  add(change, now.y, 1);
  add(change, next.y, -1);
  const double whole = fitter.held_out().dot(change, change);
  return std::max(doubt, std::min(fitter.margin(), kShare * whole) - kNothing);
}

// True for a shaft that explains most of the residual torque and rings at moments outside the
// held-out blocks, which then cannot refuse it. Its impacts are not met exactly, so the held-out
// error may rise by a small share of the fall on the training blocks.
bool rings_at_other_moments(const Fitter& fitter, const Fit& next, const Fit& now) {
  constexpr double kMost = 0.4, kNoMore = 0.1;
  ShaftFacts shaft;
  return next.members.back()->describe_shaft(shaft) &&
         next.rss_held_out - now.rss_held_out < kNoMore * (now.rss - next.rss) &&
         torque_energy(fitter, next) < kMost * torque_energy(fitter, now);
}

// True for a newcomer beside a shaft whose impacts are not simulated exactly if it is a line that
// explains very little compared with the shaft, or any effect that reduces the shaft's residual a
// little by chance.
bool is_chance_improvement(const Fitter& fitter, const Fit& next, const Fit& now) {
  constexpr double kOfShaft = 0.02, kOfRest = 0.1, kOfNoise = 0.03, kOfHeldOut = 0.02;
  if (!has_shaft(now.members)) return false;
  const Effect& newcomer = *next.members.back();
  if (is_placed(newcomer, Traits::Place::kLine) &&
      now.raw_held_out - next.raw_held_out < kOfShaft * (fitter.raw_held_out() - now.raw_held_out))
    return true;
  const bool gap = std::any_of(now.members.begin(), now.members.end(),
                               [](const auto& m) { return has_gap(*m); });
  const bool not_met = leaves_more_than_noise(fitter, now);
  if (turns_with_angle(newcomer))
    return gap && not_met && next.rss_held_out > (1 - kOfHeldOut) * now.rss_held_out;
  const double share = not_met ? kOfRest : gap ? kOfNoise : 0;
  if (share == 0) return false;
  const auto electrical = [](const Sampled& y) { return y.d.squaredNorm() + y.q.squaredNorm(); };
  return electrical(now.y) - electrical(next.y) < fitter.margin() &&
         next.y.torque.squaredNorm() > (1 - share) * now.y.torque.squaredNorm();
}

// True if a coefficient is so many standard deviations from zero that no fit without it is needed.
bool clearly_needed(const Fitter& fitter, const Fit& fit, std::size_t m) {
  constexpr double kTimes = 20;  // times the price of its parameters
  const double N = static_cast<double>(fitter.training().count(fit.y));
  const double price =
      fitter.margin() + static_cast<double>(parameters_of(*fit.members[m])) * std::log(N);
  return N * std::log1p(largest_wald(fit, fit.covariance, m) / fit.rss) > kTimes * price;
}

}  // namespace

std::string sort_of(const Effect& effect) {
  std::string sort(effect.kind());
  // A drive with a gap has a slow shaft among its neighbours, from which no search leads to the gap.
  if (is_slow_shaft(effect)) sort += " slow";
  for (const NumericKey& k : numeric_keys(effect))
    if (!k.text.empty() && effect.tracing().regressor_count() == 0) sort += " " + k.text;
  return sort;
}

std::vector<Score> ranked(const Fitter& fitter, const std::vector<Candidate>& candidates,
                          const Fit& fit) {
  std::vector<Score> scores = score_all(fitter, fit, candidates);
  const std::vector<Candidate> lines = strongest_lines(fitter.chain(), fit);
  for (Score& s : score_all(fitter, fit, lines)) scores.push_back(std::move(s));
  std::erase_if(scores, [](const Score& s) { return !s.effect || !s.valid; });
  // Of the grid points of one sort a later one must be better by more than rounding: zones that
  // contain all currents have the same gain.
  constexpr double kRounding = 1e-6;
  std::map<std::string, Score> best;
  for (const Score& s : scores) {
    const auto [place, first] = best.try_emplace(sort_of(*s.effect), s);
    const double gain = place->second.gain;
    if (!first && s.gain > gain + kRounding * std::abs(gain)) place->second = s;
  }
  std::sort(scores.begin(), scores.end(),
            [](const Score& a, const Score& b) { return a.gain > b.gain; });
  std::set<std::string> seen;
  std::erase_if(scores, [&](const Score& s) { return !seen.insert(sort_of(*s.effect)).second; });
  for (Score& s : scores) s = best.at(sort_of(*s.effect));
  return scores;
}

bool plausible(const Effect& effect, const DriveFacts& facts) {
  const Stated<Traits::Bound> bounds = effect.tracing().traits().bounds;
  for (const Traits::Bound& bound : bounds) {
    const MachineParameters& m = facts.machine;
    double unit = 1;
    if (bound.of == Traits::Bound::kStatorResistance) unit = m.R_s;
    if (bound.of == Traits::Bound::kInductanceAtRated) {
      if (!(m.i_rated > 0)) continue;
      unit = m.L_q / m.i_rated;
    }
    if (std::abs(get_key(effect, bound.key)) > bound.most * unit) return false;
  }
  return true;
}

bool acceptable(const Fitter& fitter, const Fit& next, const Fit& now) {
  const double gain = now.rss_held_out - next.rss_held_out;
  const DriveFacts& facts = fitter.chain().equations().facts();
  return next.valid &&
         (gain > least_gain(fitter, next, now) || rings_at_other_moments(fitter, next, now)) &&
         next.members.back()->tracing().materiality(facts) >= 1 &&
         plausible(*next.members.back(), facts) && !is_chance_improvement(fitter, next, now) &&
         std::none_of(now.members.begin(), now.members.end(),
                      [&](const auto& m) { return repeats_nearby(*m, *next.members.back()); }) &&
         rings(*next.members.back()) && everywhere(fitter, next, now);
}

bool is_gap(const LeftByShaft& gap, const LeftByShaft& shaft, double gain, double more,
            double margin) {
  constexpr double kGap = 0.1;         // share of the shaft's gain that the gap must add
  constexpr double kHeldOutToo = 0.8;  // of the held-out error, if a gap doubles the gain
  constexpr double kFollowed = 0.85;   // limit of the sum over pieces
  // If the noise model still contains part of the resonance, a gap and a lightly damped shaft may
  // be confused after whitening. So the residual torque in the sensors' noise must fall, too.
  const double left = gap.energy / shaft.energy;
  const bool better = left < 1 && more > std::max(margin, kGap * gain);
  // In a sum of squares a few missed impacts outweigh all that were met. Norms of pieces avoid
  // that.
  const bool followed = gap.held_out < shaft.held_out && gap.pieces < kFollowed * shaft.pieces;
  // A gap that adds more than the gain of the shaft, and lowers the held-out error, too, does not
  // depend on the whitening.
  const bool twice = more > gain && gap.held_out < kHeldOutToo * shaft.held_out;
  return better || left < kGapErrorRatio || followed || twice;
}

double credit(const Effect& effect, const Effect& other, double gain) {
  constexpr double kShare = 0.01, kMost = 500;
  const Traits::Reading* part = reading_of(other, Traits::Reading::kItsThreshold);
  const bool simpler = part && part->kind == effect.kind();
  return simpler ? std::min(kShare * gain, kMost) : 0;
}

bool like_a_gap(const Fitter& fitter, const Fit& next, const Fit& now) {
  constexpr double kGoodPart = 0.4;
  return next.valid && next.rss_held_out < (1 - kGoodPart) * now.rss_held_out &&
         next.members.back()->tracing().materiality(fitter.chain().equations().facts()) >= 1;
}

Fit without_superfluous(const Fitter& fitter, Fit fit, const Say& say) {
  for (std::size_t m = 0; fit.members.size() > 1 && m < fit.members.size();) {
    if (clearly_needed(fitter, fit, m)) {
      ++m;
      continue;
    }
    Fit without = fitter.refine(with(fit.members, nullptr, m));
    if (without.valid && score_of(fitter, without) <= score_of(fitter, fit)) {
      if (say) say(fmt::format("  without {}: not needed", fit.members[m]->kind()));
      fit = std::move(without);
      m = 0;
    } else {
      ++m;
    }
  }
  return fit;
}

}  // namespace twinrate
