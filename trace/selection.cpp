#include "trace/selection.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "model/effects/catalogue.hpp"
#include "trace/drop_shape.hpp"
#include "trace/keys.hpp"
#include "trace/placing.hpp"
#include "trace/static_sets.hpp"

namespace twinrate {
namespace {

constexpr std::size_t kMostMembers = 12;
constexpr std::size_t kMostTried = 3;   // kinds refined at each step
constexpr std::size_t kMostAsGood = 5;  // while none is acceptable, or if as good as the first
constexpr double kAsGood = 0.98;        // share of the first gain that is as good
constexpr double kNear = 0.85, kNearRough = 0.3;  // of the best gain: refined above it
constexpr double kSameMoment_s = 1e-3;            // a step that moves by less stays
constexpr double kWorseThanPlaced = 1.1;          // times the residual torque of the placed shaft

std::string describe(const Effect& effect) {
  std::string text(effect.kind());
  for (const NumericKey& k : numeric_keys(effect))
    text += k.text.empty() ? fmt::format(" {}={:.4g}", k.key, k.value) : fmt::format(" {}", k.text);
  return text;
}

std::string in_words(const std::vector<Score>& ranking) {
  std::string text = " ";
  for (std::size_t i = 0; i < std::min<std::size_t>(8, ranking.size()); ++i)
    text += fmt::format(" {} {:.0f}", sort_of(*ranking[i].effect), ranking[i].gain);
  return text;
}

bool has_step(const Members& members) {
  return std::any_of(members.begin(), members.end(),
                     [](const auto& m) { return is_placed(*m, Traits::Place::kMoment); });
}

// True if the effect equals the slope of one of the members.
bool names_a_slope(const Members& members, const Effect& effect) {
  return std::any_of(members.begin(), members.end(), [&](const auto& m) {
    const Traits::Reading* slope = reading_of(*m, Traits::Reading::kItsSlope);
    return slope && slope->kind == effect.kind();
  });
}

class Selector {
 public:
  Selector(const Fitter& fitter, const std::vector<Candidate>& candidates, const Say& say)
      : fitter_(fitter), candidates_(candidates), say_(say) {}

  Fit step(const Members& members, RoundState& state) {
    gaps_left_ = state.gaps_left;
    lines_left_ = state.lines_left;
    // A shaft converges slowly. The residual of an unconverged one would be explained by others.
    fit_ = fitter_.refine(
        members, has_shaft(members) ? Fitter::Until::kArrived : Fitter::Until::kComparable);
    if (!fit_.valid) fit_ = without_slope(std::move(fit_));
    fit_ = without_superfluous(fitter_, std::move(fit_), say_);
    const bool added = fit_.members.size() < kMostMembers && add_one();
    if (added) fit_ = without_superfluous(fitter_, std::move(fit_), say_);
    state = {added, gaps_left_, lines_left_, std::move(refused_)};
    return std::move(fit_);
  }

 private:
  // Replaces `shaft`, the fit with a torsion, by one with a gap if that is better. The best torsion
  // for a drive with a gap is overdamped, or explains nothing: then the search starts from `placed`.
  // The gap is compared with the best torsion in the sensors' noise.
  void look_for_gap(const Fit& now, const Effect& placed, Fit& shaft) {
    const double gain = score_of(fitter_, now) - score_of(fitter_, shaft);
    const bool torsion = shaft.valid && gain > fitter_.margin();
    const std::shared_ptr<Effect> start = torsion ? shaft.members.back() : placed.clone();
    const bool heard = take_heard(now, shaft);
    const Fit& before = torsion || heard ? shaft : now;
    if (gaps_left_ <= 0 || !leaves_more_than_noise(fitter_, before)) return;
    --gaps_left_;
    std::optional<Fit> gap = search_backlash(fitter_, now, *start);
    if (!gap) return;
    const double more = score_of(fitter_, before) - score_of(fitter_, *gap);
    if (say_)
      say_(fmt::format("  {}: {:.0f}; with a gap: {} {:+.0f}", describe(*shaft.members.back()),
                       gain, describe(*gap->members.back()), more));
    const auto left_by = [&](const Fit& fit) {
      return LeftByShaft{.energy = torque_energy(fitter_, fit),
                         .pieces = torque_by_pieces(fitter_, fit),
                         .held_out = fit.rss_held_out};
    };
    const LeftByShaft with_gap = left_by(*gap), without = left_by(before);
    if (acceptable(fitter_, *gap, now) && !(heard && with_gap.energy >= without.energy) &&
        is_gap(with_gap, without, torsion ? gain : 0, more, fitter_.margin()))
      shaft = std::move(*gap);
  }

  // Takes the torsion that was searched in the sensors' noise if it leaves less torque there.
  bool take_heard(const Fit& now, Fit& shaft) {
    if (heard_) {
      const Members there = with(now.members, std::exchange(heard_, nullptr));
      heard_fit_ = unless_astray(there, fitter_.refine(there, Fitter::Until::kArrived));
    }
    if (heard_fit_.members.empty() || !heard_fit_.valid ||
        (shaft.valid && torque_energy(fitter_, heard_fit_) >= torque_energy(fitter_, shaft)))
      return false;
    shaft = heard_fit_;
    return true;
  }

  // The noise model may still contain part of the resonance. Under such a model the best shaft may
  // leave much more residual torque than the placed one. Then the next round starts from the placed
  // one.
  Fit unless_astray(const Members& placed, Fit refined) const {
    Fit there = fitter_.start(placed);
    const bool astray = there.valid && kWorseThanPlaced * torque_energy(fitter_, there) <
                                           torque_energy(fitter_, refined);
    return astray ? std::move(there) : std::move(refined);
  }

  // True if the last member of `next` removes much of the torque error in the sensors' noise.
  bool is_heard(const Fit& next) const {
    return next.valid && fall_in_sensors(fitter_, fit_, next) > kTwoMissing * fitter_.margin();
  }

  bool add_one() {
    const Fit& now = fit_;
    const double score_now = score_of(fitter_, now);
    Fit best, overdamped, refused, heard;
    double best_gain = 0, first_gain = 0, refused_gain = 0, heard_gain = 0;
    std::size_t tried = 0;
    std::vector<Score> ranking = ranked(fitter_, candidates_, now);
    if (say_) say_(in_words(ranking));
    const std::shared_ptr<Effect> searched = look_for_shaft(ranking);
    for (const Score& s : ranking) {
      const bool as_good = best.members.empty() || s.gain > kAsGood * first_gain;
      if (s.gain <= 0 || tried >= (as_good ? kMostAsGood : kMostTried)) break;
      // An effect without regressors scores too low on a grid point far from its best one.
      const double near = s.effect->tracing().regressor_count() == 0 ? kNearRough : kNear;
      if (!best.members.empty() && s.gain < near * first_gain) continue;
      ++tried;
      // A shaft converges slowly, and it is compared with one that has a gap.
      const bool shaft = is_placed(*s.effect, Traits::Place::kShaft);
      const std::shared_ptr<Effect> newcomer =
          s.effect == searched ? searched : placed(fitter_, now, s.effect);
      if (step_moved(*newcomer)) return true;
      const Members there = with(now.members, newcomer);
      Fit next =
          fitter_.refine(there, shaft ? Fitter::Until::kArrived : Fitter::Until::kComparable);
      if (shaft) next = unless_astray(there, std::move(next));
      const bool beside_stiffer =
          shaft && is_slow_shaft(*s.effect) &&
          std::any_of(ranking.begin(), ranking.end(), [](const Score& other) {
            return is_placed(*other.effect, Traits::Place::kShaft) && !is_slow_shaft(*other.effect);
          });
      if (shaft && !beside_stiffer && (s.effect != searched || is_heard(next)))
        look_for_gap(now, *newcomer, next);
      if (beside_stiffer) take_heard(now, next);
      if (names_a_slope(next.members, *s.effect) || !next.valid)
        next = without_slope(std::move(next));
      if (!next.valid) next = without_threshold(std::move(next));
      double gain = score_now - score_of(fitter_, next);
      bool good = acceptable(fitter_, next, now);
      if (!good && tried == 1 && next.valid && gain > fitter_.margin() && has_step(now.members)) {
        // An earlier load step may be at the wrong moment, because this effect was missing.
        Fit anew = moments_anew(next);
        good = acceptable(fitter_, anew, now);
        if (good) {
          next = std::move(anew);
          gain = score_now - score_of(fitter_, next);
        }
      }
      if (say_)
        say_(fmt::format("  {} -> {}: score {:.0f} -> {:.0f}, held-out {:.0f} -> {:.0f}{}",
                         describe(*s.effect), describe(*next.members.back()), s.gain, gain,
                         now.rss_held_out, next.rss_held_out, good ? "" : " (refused)"));
      if (shaft && gain > 0 && !good && like_a_gap(fitter_, next, now)) overdamped = next;
      const bool less_than_noise = next.rss > 0 && next.rss_held_out <= 0;
      if (!good && (next.valid || less_than_noise) && gain > refused_gain) {
        refused_gain = gain;
        refused = next;
      }
      if ((!good || gain <= 0) && next.valid && changes_inertia(*s.effect))
        if (const double fall = fall_in_sensors(fitter_, now, next); fall > heard_gain) {
          heard_gain = fall;
          heard = next;
        }
      if (gain <= 0 || !good) continue;
      first_gain = std::max(first_gain, s.gain);
      if (best.members.empty() || preferred(next, gain, best, best_gain)) {
        best_gain = gain;
        best = std::move(next);
      }
    }
    if (best.members.empty()) best = std::move(overdamped);
    const double least = std::max(best_gain, kTwoMissing * fitter_.margin());
    if (refused_gain > least) {
      if (best.members.empty()) best = with_another(now, refused);
      refused_.push_back(std::move(refused));
    }
    if (heard_gain > least) refused_.push_back(std::move(heard));
    if (best.members.empty()) return false;
    fit_ = with_best_shape(fitter_, std::move(best), say_);
    place_anew();
    return true;
  }

  // If two effects are missing, each alone may be biased by the other on the training blocks, and
  // be refused for its held-out error. `refused` is the refused fit with the largest gain. Empty if
  // it is not acceptable with a second effect either.
  Fit with_another(const Fit& now, const Fit& refused) {
    const std::vector<Score> ranking = ranked(fitter_, candidates_, refused);
    if (ranking.empty() || ranking.front().gain < kTwoMissing * fitter_.margin()) return {};
    Fit both = moments_anew(
        fitter_.refine(with(refused.members, placed(fitter_, refused, ranking.front().effect))));
    const bool good = acceptable(fitter_, both, now) && acceptable(fitter_, both, refused);
    if (say_)
      say_(fmt::format("  {} and {}: held-out {:.0f} -> {:.0f}{}",
                       describe(*refused.members.back()), describe(*both.members.back()),
                       now.rss_held_out, both.rss_held_out, good ? "" : " (refused)"));
    return good ? both : Fit{};
  }

  // A load that rings whenever the drive moves appears as lines in the spectrum. The noise model may
  // contain all of a resonance; then no shaft has a gain, or another one has. So if a line has the
  // best score, or the torque is far above the noise of the sensors, a torsion is searched in that
  // noise. If no shaft has a gain, it is ranked behind the first effect that has one; otherwise it
  // is kept for comparison.
  std::shared_ptr<Effect> look_for_shaft(std::vector<Score>& ranking) {
    heard_ = nullptr;
    heard_fit_ = {};
    if (lines_left_ <= 0 || has_shaft(fit_.members) || ranking.empty()) return nullptr;
    const Effect& first = *ranking.front().effect;
    const bool gains = ranking.front().gain > 0;
    const bool line =
        gains && is_placed(first, Traits::Place::kLine) && get_key(first, "frequency_Hz") > 0;
    if (!line && !leaves_more_than_noise(fitter_, fit_)) return nullptr;
    const std::shared_ptr<Effect> torsion = search_torsion(fitter_, fit_, candidates_);
    --lines_left_;
    if (!torsion || !rings(*torsion)) return nullptr;
    const auto shaft = [](const Score& s) { return is_placed(*s.effect, Traits::Place::kShaft); };
    const auto shaft_gains = [&](const Score& s) { return s.gain > 0 && shaft(s); };
    if (!line && std::any_of(ranking.begin(), ranking.end(), shaft_gains)) {
      heard_ = torsion;
      return nullptr;
    }
    Score tried = ranking.front();
    tried.effect = torsion;
    std::erase_if(ranking, shaft);
    tried.gain = std::max(tried.gain, fitter_.margin());
    ranking.insert(ranking.begin() + (gains ? 1 : 0), tried);
    return torsion;
  }

  // Prefers the larger gain. If the gains are close, prefers a clearly smaller held-out error.
  static bool preferred(const Fit& next, double gain, const Fit& best, double best_gain) {
    const Effect &newer = *next.members.back(), &older = *best.members.back();
    gain += credit(newer, older, gain);
    best_gain += credit(older, newer, best_gain);
    if (std::min(gain, best_gain) > kNear * std::max(gain, best_gain)) {
      if (kWorseRatio * next.rss_held_out < best.rss_held_out) return true;
      if (kWorseRatio * best.rss_held_out < next.rss_held_out) return false;
    }
    return gain > best_gain;
  }

  // If the newcomer is a step close to one of the members, that member has the wrong moment: moves
  // it.
  bool step_moved(const Effect& newcomer) {
    for (std::size_t m = 0; m < fit_.members.size(); ++m) {
      if (!repeats_nearby(*fit_.members[m], newcomer)) continue;
      const Fit without = fitter_.refine(with(fit_.members, nullptr, m));
      Fit moved = fitter_.refine(with(without.members, placed(fitter_, without, newcomer.clone())));
      if (!moved.valid || moved.rss_held_out > fit_.rss_held_out ||
          score_of(fitter_, moved) > score_of(fitter_, fit_) - fitter_.margin())
        return false;
      if (say_) say_(fmt::format("  moved: {}", describe(*moved.members.back())));
      fit_ = std::move(moved);
      return true;
    }
    return false;
  }

  // Beside a resistance, or if it is negative, the slope of an inverter's drop is meaningless. The
  // drop is then replaced by a dead time.
  Fit without_slope(Fit fit) const {
    for (std::size_t m = 0; m < fit.members.size(); ++m) {
      if (!reading_of(*fit.members[m], Traits::Reading::kItsSlope)) continue;
      const auto dead_time =
          equivalent_dead_time(*fit.members[m], fitter_.chain().equations().facts());
      if (!dead_time) continue;
      Members members = with(fit.members, nullptr);
      members[m] = dead_time;
      Fit anew = fitter_.refine(std::move(members));
      if (anew.valid && (!fit.valid || score_of(fitter_, anew) < score_of(fitter_, fit)))
        return anew;
    }
    return fit;
  }

  // If the threshold of an inverter's drop is negative beside the newcomer, only its slope is left:
  // a resistance.
  Fit without_threshold(Fit fit) const {
    Members members = with(fit.members, nullptr);
    for (std::size_t m = 0; m + 1 < members.size(); ++m) {
      const Traits::Reading* slope = reading_of(*members[m], Traits::Reading::kItsSlope);
      if (!slope || get_key(*members[m], "threshold_V") >= 0) continue;
      if (std::any_of(members.begin(), members.end(),
                      [&](const auto& other) { return other->kind() == slope->kind; }))
        return fitter_.refine(with(members, nullptr, m));
      members[m] = read_as(*members[m], *slope, fitter_.chain().equations().facts()).effect;
      return fitter_.refine(std::move(members));
    }
    return fit;
  }

  // Places the load steps and the shaft again, because the newcomer was missing when they were
  // placed.
  void place_anew() {
    for (std::size_t m = 0; m + 1 < fit_.members.size(); ++m) {
      ShaftFacts shaft;
      if (fit_.members[m]->describe_shaft(shaft)) {
        shaft_anew(m);
        break;  // a new one is the last member
      }
    }
    fit_ = moments_anew(std::move(fit_));
  }

  // Inserts `step` as the first member. It replaces a step that it repeats nearby, except the last
  // member.
  Fit with_step(const Fit& without, const std::shared_ptr<Effect>& step) const {
    for (std::size_t m = 0; m + 1 < without.members.size(); ++m) {
      if (!repeats_nearby(*without.members[m], *step)) continue;
      const Fit alone = fitter_.refine(with(without.members, nullptr, m));
      return with_step(alone, placed(fitter_, alone, step));
    }
    Members members = with(without.members, nullptr);
    members.insert(members.begin(), step);
    return fitter_.refine(std::move(members));
  }

  // Places each load step again beside the last member, which stays the last.
  Fit moments_anew(Fit fit) const {
    for (std::size_t m = 0; m + 1 < fit.members.size(); ++m) {
      const std::shared_ptr<Effect> member = fit.members[m];
      if (!is_placed(*member, Traits::Place::kMoment)) continue;
      const Fit without = fitter_.refine(with(fit.members, nullptr, m));
      const std::shared_ptr<Effect> elsewhere = best_moment(without);
      const std::size_t count = fit.members.size();
      for (const auto& start : {member, elsewhere}) {
        if (!start || (start == elsewhere && repeats_nearby(*member, *start))) continue;
        const std::shared_ptr<Effect> there = placed(fitter_, without, start);
        if (std::abs(get_key(*there, "time_s") - get_key(*member, "time_s")) < kSameMoment_s)
          continue;
        Fit anew = with_step(without, there);
        if (anew.valid && anew.rss + anew.rss_held_out < fit.rss + fit.rss_held_out)
          fit = std::move(anew);
      }
      if (fit.members.size() < count && m > 0) --m;  // two steps became one, the next has its index
    }
    return fit;
  }

  // The load step with the largest gain in the whole record; null if it is not valid.
  std::shared_ptr<Effect> best_moment(const Fit& without) const {
    std::vector<Candidate> steps;
    for (const Candidate& c : candidates_)
      if (is_placed(*c.effect, Traits::Place::kMoment)) steps.push_back(c);
    const std::vector<Score> scores = score_all(fitter_, without, steps);
    const auto best =
        std::max_element(scores.begin(), scores.end(),
                         [](const Score& a, const Score& b) { return a.gain < b.gain; });
    return best != scores.end() && best->valid ? best->effect : nullptr;
  }

  // Places each load step again beside the gap, which is the last member, and the gap again beside
  // the steps: the best place of one depends on the other.
  Fit with_steps(Fit gap) const {
    for (std::size_t m = 0; m < gap.members.size(); ++m) {
      if (!is_placed(*gap.members[m], Traits::Place::kMoment)) continue;
      Members members = with(gap.members, nullptr);
      members[m] = placed(fitter_, fitter_.start(with(gap.members, nullptr, m)), members[m]);
      const std::size_t last = members.size() - 1;
      gap = search_closer(fitter_, fitter_.start(with(members, nullptr, last)), *members[last]);
    }
    return gap;
  }

  void shaft_anew(std::size_t m) {
    if (gaps_left_ <= 0 || !leaves_more_than_noise(fitter_, fit_)) return;
    --gaps_left_;
    const Fit without = fitter_.start(with(fit_.members, nullptr, m));
    std::optional<Fit> gap = search_backlash(fitter_, without, *fit_.members[m]);
    if (!gap) return;
    Fit anew = with_steps(std::move(*gap));
    const double better = score_of(fitter_, fit_) - score_of(fitter_, anew);
    const double left = torque_energy(fitter_, anew) / torque_energy(fitter_, fit_);
    if (say_)
      say_(fmt::format("  anew: {} {:+.0f}, {:.3g} of the rest", describe(*anew.members.back()),
                       better, left));
    if (anew.valid && rings(*anew.members.back()) &&
        ((better > 0 && left < 1) || left < kGapErrorRatio))
      fit_ = std::move(anew);
  }

  const Fitter& fitter_;
  const std::vector<Candidate>& candidates_;
  const Say& say_;
  Fit fit_;
  std::vector<Fit> refused_;
  std::shared_ptr<Effect> heard_;  // a torsion, searched in the sensors' noise; may be null
  Fit heard_fit_;                  // with it, refined; empty without one
  int gaps_left_ = 0, lines_left_ = 0;
};

}  // namespace

Fit select_one(const Fitter& fitter, const std::vector<Candidate>& candidates,
               const Members& members, const Say& say, RoundState& state) {
  return Selector(fitter, candidates, say).step(members, state);
}

Selection not_judged(Fit fit, int rounds) {
  constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
  Selection s{.fit = std::move(fit), .members = {}, .refused = {}, .stopped_after = rounds};
  for (std::size_t m = 0; m < s.fit.members.size(); ++m) {
    s.members.push_back({.score_gain = kUnknown, .held_out_gain = kUnknown, .alternatives = {}});
    s.members.back().without.rss = kUnknown;
  }
  return s;
}

}  // namespace twinrate
