#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <limits>
#include <optional>
#include <string_view>

#include "model/effects/catalogue.hpp"
#include "trace/keys.hpp"
#include "trace/parallel.hpp"
#include "trace/selection.hpp"
#include "trace/settling.hpp"

namespace twinrate {
namespace {

constexpr std::size_t kMostTried = 3;   // kinds refined in place of a member
constexpr std::size_t kMostAsGood = 6;  // the same, if they seem to explain as much
constexpr double kAsGood = 0.95;        // of a member's gain, estimated before refinement
constexpr double kNotRefined = std::numeric_limits<double>::quiet_NaN();

// True for one kind with the same choices: a filter is not a delay.
bool same_form(const Effect& a, const Effect& b) {
  if (a.kind() != b.kind()) return false;
  const std::vector<NumericKey> of_a = numeric_keys(a), of_b = numeric_keys(b);
  return std::equal(of_a.begin(), of_a.end(), of_b.begin(), of_b.end(),
                    [](const NumericKey& x, const NumericKey& y) { return x.text == y.text; });
}

class Judge {
 public:
  Judge(const Fitter& fitter, const std::vector<Candidate>& candidates, const Say& say)
      : fitter_(fitter), candidates_(candidates), say_(say) {}

  Selection finish(const Members& members) {
    selection_.fit = fitter_.refine(members);
    for (int round = 0; round < 2 && swap_one(); ++round)
      selection_.fit = without_superfluous(fitter_, std::move(selection_.fit), say_);
    Settled settled = settle(fitter_, std::move(selection_.fit), say_);
    selection_.fit = std::move(settled.fit);
    if (settled.changed) looks_.clear();
    judge_members();
    while (drop_unproven()) judge_members();
    for (const Score& s : ranked(fitter_, candidates_, selection_.fit)) {
      if (selection_.refused.size() == kMostTried) break;
      selection_.refused.push_back({std::string(s.effect->kind()), s.gain, kNotRefined,
                                    s.gain > 0 ? "fails after refinement or on the hold-out"
                                               : "does not justify its parameters"});
    }
    return std::move(selection_);
  }

  // Compares each member with its alternatives; drops none.
  Selection compare(const Members& members) {
    selection_.fit = fitter_.refine(members, Fitter::Until::kArrived);
    judge_members();
    return std::move(selection_);
  }

 private:
  // The key of its slope; null for an effect without one.
  static const char* slope_of(const Effect& effect) {
    const Traits::Reading* slope = reading_of(effect, Traits::Reading::kItsSlope);
    return slope ? slope->keys.begin()->from : nullptr;
  }

  // The fit without one member, and the candidates that could replace it.
  struct WithoutOne {
    Fit without;
    Members others;  // members of it, with the moments of the fit that has the member
    Members beside;  // the other members of the fit that has the member
    std::vector<Score> ranking;
    std::vector<std::pair<const Effect*, Fit>> refined;  // each with one of the ranking
  };
  WithoutOne look_without(std::size_t m) const {
    WithoutOne look{.without = fitter_.refine(with(selection_.fit.members, nullptr, m))};
    look.ranking = ranked(fitter_, candidates_, look.without);
    const Members in_place = with(selection_.fit.members, nullptr, m);
    look.beside = with(in_place, nullptr);
    look.others = with(look.without.members, nullptr);
    for (std::size_t i = 0; i < look.others.size(); ++i)
      if (has_key(*look.others[i], "time_s"))
        set_key(*look.others[i], "time_s", get_key(*in_place[i], "time_s"));
    return look;
  }
  const Fit& refined(WithoutOne& look, const Score& s) const {
    for (const auto& [effect, fit] : look.refined)
      if (effect == s.effect.get()) return fit;
    // A shaft may need a long descent, and may no longer ring at its end.
    ShaftFacts shaft;
    const auto until =
        s.effect->describe_shaft(shaft) ? Fitter::Until::kArrived : Fitter::Until::kComparable;
    Fit fit = fitter_.refine(with(look.others, s.effect), until);
    // Another member may have taken over the part of the member, and not return.
    const Fit beside = fitter_.linearised(with(look.beside, s.effect));
    if (beside.valid && (!fit.valid || score_of(fitter_, beside) < score_of(fitter_, fit)))
      fit = fitter_.refine(with(look.beside, s.effect), until);
    if (!fit.valid && slope_of(*s.effect)) fit = with_flat_drop(fit);
    look.refined.emplace_back(s.effect.get(), std::move(fit));
    return look.refined.back().second;
  }
  // Noise may make the slope of a device's drop negative: then a drop without a slope is used.
  Fit with_flat_drop(const Fit& fit) const {
    Members members = with(fit.members, nullptr);
    const char* slope = slope_of(*members.back());
    if (get_key(*members.back(), slope) >= 0) return fit;
    set_key(*members.back(), slope, 0);
    return fitter_.start(std::move(members));
  }
  static bool is_flat_drop(const Effect& effect) {
    const char* slope = slope_of(effect);
    return slope && get_key(effect, slope) == 0;
  }

  struct Swap {
    Fit fit;
    std::string newer;  // kind
    double gain = 0, gain_now = 0;
  };
  // The first fit with another kind or form of a member whose score is better and whose held-out
  // error is at most kWorseRatio times the present one.
  std::optional<Swap> swap_of(std::size_t m, WithoutOne& look) const {
    const Fit& without = look.without;
    const double gain_now = score_of(fitter_, without) - score_of(fitter_, selection_.fit);
    std::size_t tried = 0;
    for (const Score& s : look.ranking) {
      if (s.gain < 0.5 * gain_now || tried >= kMostTried) break;
      // Another form of an effect with coefficients is tried at the end (settle()).
      const bool settled_later = s.effect->kind() == selection_.fit.members[m]->kind() &&
                                 s.effect->tracing().regressor_count() > 0;
      if (settled_later || same_form(*s.effect, *selection_.fit.members[m])) continue;
      ++tried;
      const Fit& next = refined(look, s);
      if (is_flat_drop(*next.members.back())) continue;  // equals a dead time
      const double gain = score_of(fitter_, without) - score_of(fitter_, next);
      const Effect &newer = *next.members.back(), &older = *selection_.fit.members[m];
      if (gain + credit(newer, older, gain) <= gain_now + credit(older, newer, gain_now) + 1 ||
          !acceptable(fitter_, next, without) ||
          next.rss_held_out > kWorseRatio * selection_.fit.rss_held_out)
        continue;
      return Swap{next, std::string(s.effect->kind()), gain, gain_now};
    }
    return std::nullopt;
  }

  // Takes the swap of the first member that has one.
  bool swap_one() {
    const std::size_t count = selection_.fit.members.size();
    looks_.clear();
    looks_.resize(count);
    std::vector<std::optional<Swap>> swaps(count);
    std::atomic<std::size_t> first = count;
    for_each_index(count, [&](std::size_t m) {
      if (m > first) return;
      looks_[m] = look_without(m);
      swaps[m] = swap_of(m, looks_[m]);
      if (!swaps[m]) return;
      for (std::size_t now = first; m < now && !first.compare_exchange_weak(now, m);) {
      }
    });
    if (first == count) return false;
    Swap& swap = *swaps[first];
    if (say_)
      say_(fmt::format("  {} in place of {}: {:.0f} against {:.0f}", swap.newer,
                       selection_.fit.members[first]->kind(), swap.gain, swap.gain_now));
    selection_.fit = std::move(swap.fit);
    looks_.clear();
    return true;
  }

  // Drops the member without which the held-out error is smallest, if it is smaller.
  bool drop_unproven() {
    const auto worst = std::min_element(
        selection_.members.begin(), selection_.members.end(),
        [](const Selected& a, const Selected& b) { return a.held_out_gain < b.held_out_gain; });
    if (worst == selection_.members.end() || worst->held_out_gain >= 0 || !worst->without.valid)
      return false;
    const auto m = static_cast<std::size_t>(worst - selection_.members.begin());
    if (say_)
      say_(fmt::format("  {} goes: held-out error -{:.2g} % without",
                       selection_.fit.members[m]->kind(), -100 * worst->held_out_gain));
    selection_.fit = Fit(worst->without);
    looks_.clear();
    return true;
  }

  void judge_members() {
    const std::size_t count = selection_.fit.members.size();
    if (looks_.size() != count) {
      looks_.clear();
      looks_.resize(count);
      for_each_index(count, [&](std::size_t m) { looks_[m] = look_without(m); });
    }
    selection_.members.clear();
    selection_.members.resize(count);
    for_each_index(count,
                   [&](std::size_t m) { selection_.members[m] = judged(m, std::move(looks_[m])); });
    looks_.clear();
  }
  Selected judged(std::size_t m, WithoutOne look) const {
    Selected s{.without = look.without};
    s.score_gain = score_of(fitter_, s.without) - score_of(fitter_, selection_.fit);
    s.held_out_gain = 1 - selection_.fit.rss_held_out / s.without.rss_held_out;
    s.parameters = static_cast<double>(parameters_of(*selection_.fit.members[m]));
    std::size_t tried = 0;
    // Another member may have taken over a part, and leaves less to its own kind as well.
    double own = 0;
    for (const Score& other : look.ranking)
      if (same_form(*other.effect, *selection_.fit.members[m])) own = std::max(own, other.gain);
    own = own > 0 ? std::min(own, s.score_gain) : s.score_gain;
    for (const Score& other : look.ranking) {
      if (tried >= (other.gain > kAsGood * own ? kMostAsGood : kMostTried)) break;
      if (other.effect->kind() == selection_.fit.members[m]->kind()) continue;
      ++tried;
      Alternative a{std::string(other.effect->kind()), other.gain, kNotRefined, "",
                    static_cast<double>(parameters_of(*other.effect))};
      if (other.gain > 0.5 * own) {
        const Fit next = refined(look, other);
        a.score_gain = score_of(fitter_, s.without) - score_of(fitter_, next);
        a.held_out_gain = 1 - next.rss_held_out / s.without.rss_held_out;
        if (!next.valid) a.why = "its parameters are outside their physical range";
      }
      if (a.why.empty()) a.why = kExplainsLess;
      s.alternatives.push_back(std::move(a));
    }
    return s;
  }

  const Fitter& fitter_;
  const std::vector<Candidate>& candidates_;
  const Say& say_;
  Selection selection_;
  std::vector<WithoutOne> looks_;  // one for each member of the last set, which no swap improved
};

}  // namespace

Selection judge(const Fitter& fitter, const std::vector<Candidate>& candidates,
                const Members& members, const Say& say) {
  return Judge(fitter, candidates, say).finish(members);
}

Selection compare_alternatives(const Fitter& fitter, const std::vector<Candidate>& candidates,
                               const Members& members) {
  return Judge(fitter, candidates, {}).compare(members);
}

}  // namespace twinrate
