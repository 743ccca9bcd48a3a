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

// The newcomer is more than a few pieces of the record ask for: what they disagree by is far less
// than its size. (What rows were filled with in a few quick turns can be fitted, too.) Where much
// else is missing they disagree by that, and what acts at a few moments only is known by few of
// them; then it must take a good part of the held-out error.
bool everywhere(const Fitter& fitter, const Fit& next, const Fit& now) {
  constexpr double kSigmas = 5, kGoodPart = 0.2;
  ShaftFacts shaft;
  const std::size_t last = next.members.size() - 1;
  return next.members[last]->describe_shaft(shaft) ||
         next.rss_held_out < (1 - kGoodPart) * now.rss_held_out ||
         largest_wald(next, fitter.robust_covariance(next), last) > kSigmas * kSigmas;
}

// Of the held-out error: a share of what the newcomer changes there, which is all of it where it
// is true (what lost rows were filled with, and what a shaft leaves, can be fitted, too). Where
// it changes nothing the blocks kept back do not excite it, and cannot speak. And what holds
// noise may live on that of the others, which is not quite known.
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

// A shaft that is most of what the torque leaves, and rings at moments of which the blocks kept
// back hold none: they cannot speak.
bool rings_at_other_moments(const Fitter& fitter, const Fit& next, const Fit& now) {
  constexpr double kMost = 0.4, kNoMore = 1.1;
  ShaftFacts shaft;
  return next.members.back()->describe_shaft(shaft) &&
         next.rss_held_out < kNoMore * now.rss_held_out &&
         plain_torque(fitter, next) < kMost * plain_torque(fitter, now);
}

// Beside a shaft whose impacts are not met to the last bit: a line that explains next to nothing of
// what the shaft does; or anything that mends, by chance, a little of what the shaft leaves.
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

// Its coefficients are so many sigmas from zero that no fit without it need be tried.
bool clearly_needed(const Fitter& fitter, const Fit& fit, std::size_t m) {
  constexpr double kTimes = 20;  // what it costs
  const double N = static_cast<double>(fitter.training().count(fit.y));
  const double price =
      fitter.margin() + static_cast<double>(parameters_of(*fit.members[m])) * std::log(N);
  return N * std::log1p(largest_wald(fit, fit.covariance, m) / fit.rss) > kTimes * price;
}

}  // namespace

std::string sort_of(const Effect& effect) {
  std::string sort(effect.kind());
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
  // Of places of one sort a later one must be better by more than rounding: zones that hold all
  // currents have the same gain.
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
  constexpr double kGap = 0.1;         // of a shaft's gain: what a gap in it must bring besides
  constexpr double kHeldOutToo = 0.8;  // of the held-out error: a gap that doubles the gain
  constexpr double kFollowed = 0.85;   // of the error by pieces: such a gap is one, too
  // Whitened by a noise that is still part resonance, a gap may pass for a lightly damped shaft,
  // or the other way round.
  const double plain = gap.plain / shaft.plain;
  const bool better = plain < 1 && more > std::max(margin, kGap * gain);
  // Squares count the few impacts that were not met for more than all that were.
  const bool followed = gap.held_out < shaft.held_out && gap.pieces < kFollowed * shaft.pieces;
  // As much again as the shaft brought, and on the blocks kept back too, is no matter of weights.
  const bool twice = more > gain && gap.held_out < kHeldOutToo * shaft.held_out;
  return better || plain < kGapErrorRatio || followed || twice;
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
