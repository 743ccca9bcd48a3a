#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <string_view>

#include "trace/keys.hpp"
#include "trace/placing.hpp"
#include "trace/selection.hpp"

namespace twinrate {
namespace {

constexpr std::size_t kMostTried = 3;  // kinds refined in place of a member

// One kind, and one choice of each of its words: a filter is not a delay.
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
    compose_friction();
    join_lags();
    settle_forms();
    forget_time_constants();
    forget_first_moment();
    selection_.fit = fitter_.refine(selection_.fit.members, Fitter::Until::kArrived);
    follow_impacts();
    drop_immaterial();
    drop_uncertain();
    drop_inertia_of_impacts();
    judge_members();
    for (const Score& s : ranked(fitter_, candidates_, selection_.fit)) {
      if (selection_.refused.size() == kMostTried) break;
      selection_.refused.push_back({std::string(s.effect->kind()), s.gain, 0,
                                    s.gain > 0 ? "did not hold when refined or held out"
                                               : "does not pay for its parameters"});
    }
    return std::move(selection_);
  }

 private:
  static constexpr const char* kSlope = "resistance_Ohm";

  // The others of the set without one, and what could stand in its place.
  struct WithoutOne {
    Fit without;
    std::vector<Score> ranking;
    std::vector<std::pair<const Effect*, Fit>> refined;  // with one of the ranking
  };
  WithoutOne look_without(std::size_t m) const {
    WithoutOne look{.without = fitter_.refine(with(selection_.fit.members, nullptr, m))};
    look.ranking = ranked(fitter_, candidates_, look.without);
    return look;
  }
  const Fit& refined(WithoutOne& look, const Score& s) const {
    for (const auto& [effect, fit] : look.refined)
      if (effect == s.effect.get()) return fit;
    // A shaft has far to go, and may no longer ring when it has arrived.
    ShaftFacts shaft;
    const auto until =
        s.effect->describe_shaft(shaft) ? Fitter::Until::kArrived : Fitter::Until::kComparable;
    Fit fit = fitter_.refine(with(look.without.members, s.effect), until);
    if (!fit.valid && s.effect->kind() == "inverter_drop") fit = with_flat_drop(fit);
    look.refined.emplace_back(s.effect.get(), std::move(fit));
    return look.refined.back().second;
  }
  // Noise may tilt a device's drop below zero: a flat one is what there can be of it.
  Fit with_flat_drop(const Fit& fit) const {
    Members members = with(fit.members, nullptr);
    if (get_key(*members.back(), kSlope) >= 0) return fit;
    set_key(*members.back(), kSlope, 0);
    return fitter_.start(std::move(members));
  }
  static bool is_flat_drop(const Effect& effect) {
    return effect.kind() == "inverter_drop" && get_key(effect, kSlope) == 0;
  }

  // Two sorts of friction can stand in for three others so well that no third adds to them: all
  // sorts together, less those that are not needed.
  void compose_friction() {
    constexpr std::string_view kSorts[] = {"viscous_friction", "coulomb_friction",
                                           "stribeck_friction", "fan_load"};
    Members members = selection_.fit.members;
    const auto has = [&](std::string_view sort) {
      return std::any_of(members.begin(), members.end(),
                         [&](const auto& m) { return m->kind() == sort; });
    };
    if (std::count_if(std::begin(kSorts), std::end(kSorts), has) < 2) return;
    for (std::string_view sort : kSorts)
      if (!has(sort)) members = with(members, make_effect(sort));
    // Where it is not there, a sort of friction is found on either side of zero.
    members = fitter_.refine(members, Fitter::Until::kArrived).members;
    const DriveFacts& facts = fitter_.chain().equations().facts();
    std::erase_if(members, [&](const auto& m) {
      return std::count(std::begin(kSorts), std::end(kSorts), m->kind()) &&
             (!within_ranges(*m) || m->materiality(facts) < 1);
    });
    Fit composed = without_superfluous(fitter_, fitter_.refine(members), {});
    if (!composed.valid ||
        score_of(fitter_, composed) > score_of(fitter_, selection_.fit) - fitter_.margin() ||
        composed.rss_held_out > selection_.fit.rss_held_out)
      return;
    if (say_) say_("  friction composed anew");
    selection_.fit = std::move(composed);
    looks_.clear();
  }

  // Angle and currents that are late by the same time are a voltage that is.
  void join_lags() {
    constexpr double kSame = 0.05, kAsGood = 1.05;  // of the time; of the held-out error
    Members others = with(selection_.fit.members, nullptr);
    const auto take = [&](double signal) {
      const auto late = std::find_if(others.begin(), others.end(), [&](const auto& m) {
        return m->kind() == "signal_lag" && get_key(*m, "signal") == signal;
      });
      if (late == others.end()) return 0.0;
      const double lag = get_key(**late, "lag_s");
      others.erase(late);
      return lag;
    };
    const double angle = take(SamplingFacts::kAngle), current = take(SamplingFacts::kCurrent);
    if (angle == 0 || std::abs(current / angle - 1) > kSame) return;
    const Fit before = selection_.fit;
    for (double form : {0., 1.}) {
      const std::shared_ptr<Effect> voltage = make_effect("signal_lag");
      set_key(*voltage, "signal", SamplingFacts::kVoltage);
      set_key(*voltage, "form", form);
      set_key(*voltage, "lag_s", angle);
      Fit joined = fitter_.refine(with(others, voltage), Fitter::Until::kArrived);
      if (!joined.valid || joined.rss_held_out > kAsGood * before.rss_held_out ||
          (form > 0 && joined.rss > selection_.fit.rss))
        continue;
      if (say_) say_("  late angle and currents: a late voltage");
      selection_.fit = std::move(joined);
      looks_.clear();
    }
  }

  // Curves that begin alike (tanh and square take a cube of a small current) are told apart when
  // each is fitted.
  void settle_forms() {
    for (std::size_t m = 0; m < selection_.fit.members.size(); ++m) {
      const Effect& member = *selection_.fit.members[m];
      if (member.regressor_count() == 0) continue;  // swapped like another kind
      for (const TracedKey& key : member.traced_keys()) {
        if (std::string_view(key.key) != "form") continue;
        for (double form : key.grid) {
          Members others = with(selection_.fit.members, nullptr);
          set_key(*others[m], key.key, form);
          Fit other = fitter_.refine(std::move(others), Fitter::Until::kArrived);
          if (!other.valid || score_of(fitter_, other) >= score_of(fitter_, selection_.fit))
            continue;
          selection_.fit = std::move(other);
          looks_.clear();
        }
        break;
      }
    }
  }

  // A drift that was over before the record began is a change.
  void forget_time_constants() {
    constexpr double kAsGood = 10;  // of the score
    for (std::size_t m = 0; m < selection_.fit.members.size(); ++m) {
      const std::vector<NumericKey> keys = numeric_keys(*selection_.fit.members[m]);
      const char* const key = "time_constant_s";
      if (std::none_of(keys.begin(), keys.end(),
                       [&](const NumericKey& k) { return k.key == key && k.value > 0; }))
        continue;
      Members others = with(selection_.fit.members, nullptr);
      set_key(*others[m], key, 0);
      Fit other = fitter_.refine(std::move(others));
      if (!other.valid || score_of(fitter_, other) > score_of(fitter_, selection_.fit) + kAsGood)
        continue;
      selection_.fit = std::move(other);
      looks_.clear();
    }
  }

  // A step at the very beginning of the record is a load that was always there.
  void forget_first_moment() {
    constexpr double kBeginning_s = 0.03;
    const double begin = fitter_.chain().equations().record().t.front();
    Members members = with(selection_.fit.members, nullptr);
    for (auto& m : members) {
      if (m->kind() != "load_step" || get_key(*m, "time_s") > begin + kBeginning_s) continue;
      if (std::any_of(members.begin(), members.end(),
                      [](const auto& other) { return other->kind() == "constant_load"; }))
        return;
      const std::shared_ptr<Effect> load = make_effect("constant_load");
      set_key(*load, "torque_Nm", get_key(*m, "torque_Nm"));
      m = load;
      Fit always = fitter_.refine(std::move(members));
      if (!always.valid) return;
      selection_.fit = std::move(always);
      looks_.clear();
      return;
    }
  }

  // A gap was found before what came later, and its keys may be those of a hollow beside the true
  // one, in which an inertia helps: near it again, with all others known, without that inertia,
  // too.
  void follow_impacts() {
    constexpr double kPlainly = 0.8, kSimpler = 0.98;  // of what was left of the torque
    const Members& now = selection_.fit.members;
    const auto gap =
        std::find_if(now.begin(), now.end(), [](const auto& m) { return has_gap(*m); });
    if (gap == now.end() || !leaves_more_than_noise(fitter_, selection_.fit)) return;
    Members others = with(now, nullptr, static_cast<std::size_t>(gap - now.begin()));
    const std::shared_ptr<Effect> shaft = (*gap)->clone();
    Fit best;
    const double before = plain_torque(fitter_, selection_.fit);
    double least = kPlainly * before;
    for (bool look = true; look;) {
      Fit near = search_closer(fitter_, fitter_.start(others), *shaft);
      const double left = plain_torque(fitter_, near);
      if (say_) say_(fmt::format("  impacts followed anew leave {:.3g}", left / before));
      if (near.valid && rings(*near.members.back()) && left < least) {
        least = left;
        best = std::move(near);
      }
      look = std::erase_if(others, [](const auto& m) { return m->kind() == "inertia"; }) > 0;
      if (look && best.members.empty()) least = kSimpler * before;
    }
    if (best.members.empty()) return;
    selection_.fit = std::move(best);
    looks_.clear();
  }

  // Beside what came later too small to be worth reporting. A shaft's size is no one key's.
  void drop_immaterial() {
    const DriveFacts& facts = fitter_.chain().equations().facts();
    ShaftFacts shaft;
    for (std::size_t m = 0; m < selection_.fit.members.size();) {
      const Effect& member = *selection_.fit.members[m];
      if (member.describe_shaft(shaft) || member.materiality(facts) >= 1) {
        ++m;
        continue;
      }
      if (say_) say_(fmt::format("  without {}: too small", selection_.fit.members[m]->kind()));
      selection_.fit =
          fitter_.refine(with(selection_.fit.members, nullptr, m), Fitter::Until::kArrived);
      looks_.clear();
      m = 0;
    }
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
        if (same_form(*s.effect, *selection_.fit.members[m])) continue;
        ++tried;
        Fit next = refined(looks_.back(), s);
        if (is_flat_drop(*next.members.back())) continue;  // a dead time by another name
        const double gain = score_of(fitter_, without) - score_of(fitter_, next);
        if (gain <= gain_now + 1 || !acceptable(fitter_, next, without)) continue;
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
};

}  // namespace

Selection judge(const Fitter& fitter, const std::vector<Candidate>& candidates,
                const Members& members, const Say& say) {
  return Judge(fitter, candidates, say).finish(members);
}

}  // namespace twinrate
