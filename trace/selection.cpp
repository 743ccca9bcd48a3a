#include "trace/selection.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "trace/keys.hpp"
#include "trace/lines.hpp"
#include "trace/placing.hpp"
#include "trace/static_sets.hpp"

namespace twinrate {
namespace {

constexpr std::size_t kMostMembers = 12;
constexpr std::size_t kMostTried = 3;  // kinds refined at each step
constexpr double kGap = 0.1;           // of a shaft's gain: what a gap in it must bring besides
constexpr double kPlainly = 0.75;      // of the plain error: a gap that leaves less is one
constexpr double kNear = 0.85, kNearRough = 0.3;  // of the best gain: still worth refining

// Candidates of one sort differ in a place on a grid only.
std::string sort_of(const Effect& effect) {
  std::string sort(effect.kind());
  for (const NumericKey& k : numeric_keys(effect))
    if (!k.text.empty() && effect.kind() == "signal_lag") sort += " " + k.text;
  return sort;
}

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

class Selector {
 public:
  Selector(const Fitter& fitter, const std::vector<Candidate>& candidates, const Say& say)
      : fitter_(fitter), candidates_(candidates), say_(say) {}

  Fit step(const Members& members, Progress& progress) {
    gaps_left_ = progress.gaps_left;
    selection_.fit = fitter_.refine(members);
    if (!selection_.fit.valid) selection_.fit = without_slope(std::move(selection_.fit));
    drop_superfluous();
    const bool added = selection_.fit.members.size() < kMostMembers && add_one();
    if (added) drop_superfluous();
    progress = {added, gaps_left_};
    return std::move(selection_.fit);
  }
  Selection finish(const Members& members) {
    selection_.fit = fitter_.refine(members);
    for (int round = 0; round < 2 && swap_one(); ++round) drop_superfluous();
    selection_.fit = fitter_.refine(selection_.fit.members, Fitter::Until::kArrived);
    drop_uncertain();
    drop_inertia_of_impacts();
    judge_members();
    for (const Score& s : ranked(selection_.fit)) {
      if (selection_.refused.size() == kMostTried) break;
      selection_.refused.push_back({std::string(s.effect->kind()), s.gain, 0,
                                    s.gain > 0 ? "did not hold when refined or held out"
                                               : "does not pay for its parameters"});
    }
    return std::move(selection_);
  }

 private:
  // Best of each kind, best kind first.
  std::vector<Score> ranked(const Fit& fit) const {
    std::vector<Score> scores = score_all(fitter_, fit, candidates_);
    const std::vector<Candidate> lines = strongest_lines(fitter_.chain(), fit);
    for (Score& s : score_all(fitter_, fit, lines)) scores.push_back(std::move(s));
    std::erase_if(scores, [](const Score& s) { return !s.effect || !s.valid; });
    std::sort(scores.begin(), scores.end(),
              [](const Score& a, const Score& b) { return a.gain > b.gain; });
    std::set<std::string> seen;
    std::erase_if(scores, [&](const Score& s) { return !seen.insert(sort_of(*s.effect)).second; });
    return scores;
  }

  bool acceptable(const Fit& next, const Fit& now) const {
    const double gain = now.rss_held_out - next.rss_held_out;
    return next.valid && gain > least_gain(next, now) &&
           next.members.back()->materiality(fitter_.chain().equations().facts()) >= 1 &&
           !crumb(next, now) && rings(*next.members.back()) && everywhere(next);
  }

  // The newcomer is more than a few pieces of the record ask for: what they disagree by is far less
  // than its size. (What rows were filled with in a few quick turns can be fitted, too.)
  bool everywhere(const Fit& next) const {
    constexpr double kSigmas = 5;
    ShaftFacts shaft;
    const std::size_t last = next.members.size() - 1;
    return next.members[last]->describe_shaft(shaft) ||
           largest_wald(next, fitter_.robust_covariance(next), last) > kSigmas * kSigmas;
  }

  // Of the held-out error: a share of what the newcomer changes there, which is all of it where it
  // is true (what lost rows were filled with, and what a shaft leaves, can be fitted, too). Where
  // it changes nothing the blocks kept back do not excite it, and cannot speak. And what holds
  // noise may live on that of the others, which is not quite known.
  double least_gain(const Fit& next, const Fit& now) const {
    constexpr double kShare = 0.4, kNothing = 1;
    const Effect& newcomer = *next.members.back();
    const double doubt = holds_noise(newcomer) ? now.doubt : -kNothing;
    ShaftFacts shaft;
    if (newcomer.describe_shaft(shaft)) return doubt;
    Sampled change;
    add(change, now.y, 1);
    add(change, next.y, -1);
    const double whole = fitter_.held_out().dot(change, change);
    return std::max(doubt, std::min(fitter_.margin(), kShare * whole) - kNothing);
  }

  // A line beside a shaft that explains next to nothing of what the shaft does: impacts are never
  // met to the last bit.
  bool crumb(const Fit& next, const Fit& now) const {
    constexpr double kLeast = 0.02;
    if (next.members.back()->kind() != "periodic_torque") return false;
    return has_shaft(now.members) && now.raw_held_out - next.raw_held_out <
                                         kLeast * (fitter_.raw_held_out() - now.raw_held_out);
  }

  // Puts a shaft with a gap in the place of `shaft`, the fit with a torsion, where that is better.
  // A gap makes the torsion that comes nearest overdamped.
  void look_for_gap(const Fit& now, Fit& shaft) {
    const double gain = score_of(fitter_, now) - score_of(fitter_, shaft);
    if (gain < fitter_.margin() || !leaves_more_than_noise(fitter_, shaft) || gaps_left_ <= 0)
      return;
    --gaps_left_;
    Fit gap = search_backlash(fitter_, now, *shaft.members.back());
    const double more = score_of(fitter_, shaft) - score_of(fitter_, gap);
    if (say_)
      say_(fmt::format("  {}: {:.0f}; with a gap: {} {:+.0f}", describe(*shaft.members.back()),
                       gain, describe(*gap.members.back()), more));
    // Whitened by a noise that is still part resonance, a gap may pass for a lightly damped shaft,
    // or the other way round.
    const double plain = plain_torque(fitter_, gap) / plain_torque(fitter_, shaft);
    const bool better = plain < 1 && more > std::max(fitter_.margin(), kGap * gain);
    if (acceptable(gap, now) && (better || plain < kPlainly)) shaft = std::move(gap);
  }

  bool add_one() {
    const Fit& now = selection_.fit;
    const double score_now = score_of(fitter_, now);
    Fit best;
    double best_gain = 0, first_gain = 0;
    std::size_t tried = 0;
    const std::vector<Score> ranking = ranked(now);
    if (say_) say_(in_words(ranking));
    for (const Score& s : ranking) {
      if (s.gain <= 0 || tried >= kMostTried + (best.members.empty() ? 2 : 0)) break;
      // Far from its best point on a grid, an effect without regressors scores too low.
      const double near = s.effect->regressor_count() == 0 ? kNearRough : kNear;
      if (!best.members.empty() && s.gain < near * first_gain) continue;
      ++tried;
      // A shaft has far to go, and is compared with one that has a gap.
      const bool shaft = s.effect->kind() == "torsion";
      Fit next = fitter_.refine(with(now.members, placed(fitter_, now, s.effect)),
                                shaft ? Fitter::Until::kArrived : Fitter::Until::kComparable);
      if (shaft) look_for_gap(now, next);
      if (s.effect->kind() == "resistance") next = without_slope(std::move(next));
      const double gain = score_now - score_of(fitter_, next);
      const bool good = acceptable(next, now);
      if (say_)
        say_(fmt::format("  {} -> {}: score {:.0f} -> {:.0f}, held-out {:.0f} -> {:.0f}{}",
                         describe(*s.effect), describe(*next.members.back()), s.gain, gain,
                         now.rss_held_out, next.rss_held_out, good ? "" : " (refused)"));
      if (gain <= 0 || !good) continue;
      first_gain = std::max(first_gain, s.gain);
      if (gain > best_gain) {
        best_gain = gain;
        best = std::move(next);
      }
    }
    if (best.members.empty()) return false;
    selection_.fit = std::move(best);
    place_anew();
    return true;
  }

  // Beside a resistance, or below zero, the slope of an inverter's drop has nothing left to say:
  // what remains of it is a dead time.
  Fit without_slope(Fit fit) const {
    for (std::size_t m = 0; m < fit.members.size(); ++m) {
      if (fit.members[m]->kind() != "inverter_drop") continue;
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

  // What stands at a moment of the record, and a shaft, were placed before the newcomer was in the
  // model.
  void place_anew() {
    for (std::size_t m = 0; m + 1 < selection_.fit.members.size(); ++m) {
      ShaftFacts shaft;
      if (selection_.fit.members[m]->describe_shaft(shaft)) {
        shaft_anew(m);
        break;  // it is the last member now
      }
    }
    for (std::size_t m = 0; m + 1 < selection_.fit.members.size(); ++m) {
      const std::shared_ptr<Effect> member = selection_.fit.members[m];
      if (member->kind() != "load_step") continue;
      const Fit without = fitter_.start(with(selection_.fit.members, nullptr, m));
      Fit anew = fitter_.refine(with(without.members, placed(fitter_, without, member)));
      if (anew.valid &&
          anew.rss + anew.rss_held_out < selection_.fit.rss + selection_.fit.rss_held_out)
        selection_.fit = std::move(anew);
    }
  }

  void shaft_anew(std::size_t m) {
    if (gaps_left_ <= 0 || !leaves_more_than_noise(fitter_, selection_.fit)) return;
    --gaps_left_;
    const Fit without = fitter_.start(with(selection_.fit.members, nullptr, m));
    Fit anew = search_backlash(fitter_, without, *selection_.fit.members[m]);
    if (say_) say_(fmt::format("  anew: {}", describe(*anew.members.back())));
    if (anew.valid && rings(*anew.members.back()) &&
        score_of(fitter_, anew) < score_of(fitter_, selection_.fit) &&
        plain_torque(fitter_, anew) < plain_torque(fitter_, selection_.fit))
      selection_.fit = std::move(anew);
  }

  // Its coefficients are so many sigmas from zero that no fit without it need be tried.
  bool clearly_needed(std::size_t m) const {
    constexpr double kTimes = 20;  // what it costs
    const Fit& fit = selection_.fit;
    const double N = static_cast<double>(fitter_.training().count(fit.y));
    const double price =
        fitter_.margin() + static_cast<double>(parameters_of(*fit.members[m])) * std::log(N);
    return N * std::log1p(largest_wald(fit, fit.covariance, m) / fit.rss) > kTimes * price;
  }

  void drop_superfluous() {
    for (std::size_t m = 0;
         selection_.fit.members.size() > 1 && m < selection_.fit.members.size();) {
      if (clearly_needed(m)) {
        ++m;
        continue;
      }
      Fit without = fitter_.refine(with(selection_.fit.members, nullptr, m));
      if (without.valid && score_of(fitter_, without) <= score_of(fitter_, selection_.fit)) {
        if (say_) say_(fmt::format("  without {}: not needed", selection_.fit.members[m]->kind()));
        selection_.fit = std::move(without);
        m = 0;
      } else {
        ++m;
      }
    }
  }

  // The others of the set without one, and what could stand in its place.
  struct WithoutOne {
    Fit without;
    std::vector<Score> ranking;
    std::vector<std::pair<const Effect*, Fit>> refined;  // with one of the ranking
  };
  WithoutOne look_without(std::size_t m) const {
    WithoutOne look{.without = fitter_.refine(with(selection_.fit.members, nullptr, m))};
    look.ranking = ranked(look.without);
    return look;
  }
  const Fit& refined(WithoutOne& look, const Score& s) const {
    for (const auto& [effect, fit] : look.refined)
      if (effect == s.effect.get()) return fit;
    // A shaft has far to go, and may no longer ring when it has arrived.
    ShaftFacts shaft;
    const auto until =
        s.effect->describe_shaft(shaft) ? Fitter::Until::kArrived : Fitter::Until::kComparable;
    look.refined.emplace_back(s.effect.get(),
                              fitter_.refine(with(look.without.members, s.effect), until));
    return look.refined.back().second;
  }

  // Members that, beside all the others, are within three of their own standard deviations of
  // nothing, the least certain first.
  void drop_uncertain() {
    constexpr double kSigmas = 3;
    while (true) {
      const Fit& fit = selection_.fit;
      const Eigen::MatrixXd covariance = fitter_.robust_covariance(fit);
      std::size_t least = kNobody;
      double smallest = kSigmas * kSigmas;
      for (std::size_t m = 0; m < fit.members.size(); ++m) {
        ShaftFacts shaft;
        if (fit.members[m]->describe_shaft(shaft)) continue;
        const double wald = largest_wald(fit, covariance, m);
        if (wald < smallest) smallest = wald, least = m;
      }
      if (least == kNobody) return;
      if (say_) say_(fmt::format("  without {}: not certain", fit.members[least]->kind()));
      selection_.fit = fitter_.refine(with(fit.members, nullptr, least), Fitter::Until::kArrived);
      looks_.clear();
    }
  }

  // Beside a shaft that stands for a gap whose impacts could not be followed an inertia mends what
  // they leave.
  void drop_inertia_of_impacts() {
    const Fit& fit = selection_.fit;
    const bool torsion = std::any_of(fit.members.begin(), fit.members.end(),
                                     [](const auto& m) { return m->kind() == "torsion"; });
    if (!torsion || !leaves_more_than_noise(fitter_, fit)) return;
    for (std::size_t m = 0; m < fit.members.size(); ++m) {
      if (fit.members[m]->kind() != "inertia") continue;
      Fit without = fitter_.refine(with(fit.members, nullptr, m), Fitter::Until::kArrived);
      if (!without.valid) return;
      if (say_) say_("  without inertia: it mends what a shaft leaves");
      selection_.fit = std::move(without);
      looks_.clear();
      return;
    }
  }

  // Puts one other kind in the place of a member where that is better.
  bool swap_one() {
    looks_.clear();
    for (std::size_t m = 0; m < selection_.fit.members.size(); ++m) {
      looks_.push_back(look_without(m));
      const Fit without = looks_.back().without;
      const double gain_now = score_of(fitter_, without) - score_of(fitter_, selection_.fit);
      std::size_t tried = 0;
      for (const Score& s : looks_.back().ranking) {
        if (s.gain < 0.5 * gain_now || tried >= kMostTried) break;
        if (s.effect->kind() == selection_.fit.members[m]->kind()) continue;
        ++tried;
        Fit next = refined(looks_.back(), s);
        const double gain = score_of(fitter_, without) - score_of(fitter_, next);
        if (gain <= gain_now + 1 || !acceptable(next, without)) continue;
        if (say_)
          say_(fmt::format("  {} in place of {}: {:.0f} against {:.0f}", s.effect->kind(),
                           selection_.fit.members[m]->kind(), gain, gain_now));
        selection_.fit = std::move(next);
        looks_.clear();
        return true;
      }
    }
    return false;
  }

  void judge_members() {
    selection_.members.clear();
    for (std::size_t m = 0; m < selection_.fit.members.size(); ++m) {
      const bool known = looks_.size() == selection_.fit.members.size();
      WithoutOne look = known ? std::move(looks_[m]) : look_without(m);
      Selected s{.without = look.without};
      s.score_gain = score_of(fitter_, s.without) - score_of(fitter_, selection_.fit);
      s.held_out_gain = 1 - selection_.fit.rss_held_out / s.without.rss_held_out;
      s.parameters = static_cast<double>(parameters_of(*selection_.fit.members[m]));
      std::size_t tried = 0;
      for (const Score& other : look.ranking) {
        if (tried >= kMostTried) break;
        if (other.effect->kind() == selection_.fit.members[m]->kind()) continue;
        ++tried;
        Alternative a{std::string(other.effect->kind()), other.gain, 0, "",
                      static_cast<double>(parameters_of(*other.effect))};
        if (other.gain > 0.5 * s.score_gain) {
          const Fit next = refined(look, other);
          a.score_gain = score_of(fitter_, s.without) - score_of(fitter_, next);
          a.held_out_gain = 1 - next.rss_held_out / s.without.rss_held_out;
          if (!next.valid) a.why = "its parameters leave their physical range";
        }
        if (a.why.empty()) a.why = kExplainsLess;
        s.alternatives.push_back(std::move(a));
      }
      selection_.members.push_back(std::move(s));
    }
  }

  const Fitter& fitter_;
  const std::vector<Candidate>& candidates_;
  const Say& say_;
  Selection selection_;
  std::vector<WithoutOne> looks_;  // by member of the last set that no swap made better
  int gaps_left_ = 0;
};

}  // namespace

Fit select_one(const Fitter& fitter, const std::vector<Candidate>& candidates,
               const Members& members, const Say& say, Progress& progress) {
  return Selector(fitter, candidates, say).step(members, progress);
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

Selection judge(const Fitter& fitter, const std::vector<Candidate>& candidates,
                const Members& members, const Say& say) {
  return Selector(fitter, candidates, say).finish(members);
}

}  // namespace twinrate
