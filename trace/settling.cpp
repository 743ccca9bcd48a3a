#include "trace/settling.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <string_view>

#include "model/effects/catalogue.hpp"
#include "trace/keys.hpp"
#include "trace/placing.hpp"

namespace twinrate {
namespace {

// Keys of a friction curve.
constexpr const char *kExponent = "exponent", *kSmoothing = "smooth_rad_s";

class Settler {
 public:
  Settler(const Fitter& fitter, Fit fit, const Say& say)
      : fitter_(fitter), say_(say), fit_(std::move(fit)) {}

  Settled operator()() {
    compose_friction();
    take_one_friction_law();
    join_lags();
    forget_time_constants();
    forget_first_moment();
    if (Fit arrived = fitter_.refine(fit_.members, Fitter::Until::kArrived); arrived.valid)
      fit_ = std::move(arrived);
    follow_impacts();
    drop_immaterial();
    drop_inertia_of_impacts();
    return {std::move(fit_), changed_};
  }

 private:
  std::vector<std::string> considered_friction() const {
    return fitter_.chain().equations().considered().of(kinds_of(Traits::Family::kFriction));
  }

  // Two kinds of friction can replace three others so well that no third one improves the fit. So
  // all kinds are fitted together, and the superfluous ones are removed. Two kinds can replace one
  // whose curve has another exponent.
  void compose_friction() {
    const Members found = fit_.members;
    compose_friction(with(found, nullptr));
    for (std::size_t m = 0; m < found.size(); ++m) {
      if (!is_of(*found[m], Traits::Family::kFriction) || !has_key(*found[m], "exponent")) continue;
      Members members = with(found, nullptr);
      set_key(*members[m], "exponent", 1);
      compose_friction(std::move(members));
    }
  }

  void compose_friction(Members members) {
    const std::vector<std::string> sorts = considered_friction();
    const auto has = [&](const std::string& sort) {
      return std::any_of(members.begin(), members.end(),
                         [&](const auto& m) { return m->kind() == sort; });
    };
    if (std::count_if(sorts.begin(), sorts.end(), has) < 2) return;
    for (const std::string& sort : sorts)
      if (!has(sort)) members = with(members, make_effect(sort));
    // The coefficient of an absent kind of friction may have either sign.
    members = fitter_.refine(members, Fitter::Until::kArrived).members;
    const Equations& equations = fitter_.chain().equations();
    std::erase_if(members, [&](const auto& m) {
      return is_of(*m, Traits::Family::kFriction) &&
             (!equations.possible(*m) || m->tracing().materiality(equations.facts()) < 1);
    });
    Fit composed = without_superfluous(fitter_, fitter_.refine(members), {});
    if (!composed.valid ||
        score_of(fitter_, composed) > score_of(fitter_, fit_) - fitter_.margin() ||
        composed.rss_held_out > fit_.rss_held_out)
      return;
    if (say_) say_("  friction combined again");
    fit_ = std::move(composed);
    changed_ = true;
  }

  // A friction law with another exponent or smoothing looks like two or three kinds, or like one
  // that leaves a residual. So a single kind with a fitted shape is used if it is better.
  void take_one_friction_law() {
    const auto is_friction = [](const auto& m) { return is_of(*m, Traits::Family::kFriction); };
    const auto count = std::count_if(fit_.members.begin(), fit_.members.end(), is_friction);
    if (count == 0 || (count == 1 && !has_another_shape())) return;
    Members others = with(fit_.members, nullptr);
    std::erase_if(others, is_friction);
    for (const std::string& sort : considered_friction()) {
      const auto member = std::find_if(fit_.members.begin(), fit_.members.end(),
                                       [&](const auto& m) { return m->kind() == sort; });
      const std::shared_ptr<Effect> law =
          member == fit_.members.end() ? make_effect(sort) : (*member)->clone();
      if (!has_key(*law, kSmoothing)) continue;
      Fit one = with_shape(others, law);
      // Each key of the shape is one more parameter.
      const double price = 2 * std::log(static_cast<double>(fitter_.training().count(fit_.y)));
      if (!one.valid || score_of(fitter_, one) + price > score_of(fitter_, fit_) ||
          one.rss_held_out > fit_.rss_held_out)
        continue;
      if (say_) say_(fmt::format("  one friction: {}", sort));
      fit_ = std::move(one);
      changed_ = true;
    }
  }

  // True if the only friction leaves more than noise, or fits better with a very different
  // smoothing.
  bool has_another_shape() const {
    constexpr double kOther_rad_s = 0.2;
    if (leaves_more_than_noise(fitter_, fit_)) return true;
    Members members = with(fit_.members, nullptr);
    for (auto& m : members)
      if (is_of(*m, Traits::Family::kFriction) && has_key(*m, kSmoothing))
        set_key(*m, kSmoothing, kOther_rad_s);
    const Fit other = fitter_.refine(std::move(members));
    return other.valid && other.rss < fit_.rss;
  }

  // `others` and the law as the last member, with the exponent and the smoothing that explain most:
  // first on grids, one key after the other, then in ever smaller factors.
  Fit with_shape(const Members& others, const std::shared_ptr<Effect>& law) const {
    constexpr int kMostPasses = 3;
    Fit best = fitter_.refine(with(others, law));
    const auto look = [&](const char* key, double value) {
      const Effect& now = *best.members.back();
      const std::shared_ptr<Effect> there = now.clone();
      set_key(*there, key, value);
      if (get_key(*there, key) == get_key(now, key)) return;
      Fit other = fitter_.refine(with(others, there));
      if (other.valid && (!best.valid || other.rss < best.rss)) best = std::move(other);
    };
    const bool has_exponent = has_key(*law, kExponent);
    double before = 0;
    for (int pass = 0; pass < kMostPasses && (pass == 0 || best.rss < before); ++pass) {
      before = best.rss;
      if (has_exponent)
        for (double exponent : {0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0}) look(kExponent, exponent);
      for (double smooth_rad_s : {0.02, 0.06, 0.2, 0.6, 2.0}) look(kSmoothing, smooth_rad_s);
    }
    for (double factor : {1.5, 1.2, 1.1, 1.05, 1.02})
      for (const char* key : {kExponent, kSmoothing}) {
        if (key == kExponent && !has_exponent) continue;
        const double from = get_key(*best.members.back(), key);
        look(key, from * factor);
        look(key, from / factor);
      }
    return best;
  }

  // An angle and currents that are late by the same time are equivalent to a late voltage. Lags of
  // nearly the same time are joined if the late voltage explains more. If the voltage is
  // late, too, no record determines their shares.
  void join_lags() {
    // Tolerances of the time, and factor of the held-out error. Late readings lower that error,
    // because between two rows they are means.
    constexpr double kSame = 0.05, kNearlySame = 0.5, kAsGood = 1.15;
    Members others = with(fit_.members, nullptr);
    const auto take = [&](double signal) {
      const auto late = std::find_if(others.begin(), others.end(), [&](const auto& m) {
        return is_of(*m, Traits::Family::kLag) && get_key(*m, "signal") == signal;
      });
      if (late == others.end()) return 0.0;
      const double lag = get_key(**late, "lag_s");
      others.erase(late);
      return lag;
    };
    const double angle = take(SamplingFacts::kAngle), current = take(SamplingFacts::kCurrent),
                 voltage_before = take(SamplingFacts::kVoltage);
    if (angle == 0 || current == 0) return;
    const bool same = voltage_before != 0 || std::abs(current / angle - 1) <= kSame;
    if (!same && std::abs(current / angle - 1) > kNearlySame) return;
    const double later = voltage_before + (angle + current) / 2;
    const Fit before = fit_;
    for (double form : {0., 1.}) {
      const std::shared_ptr<Effect> voltage = make_of(Traits::Family::kLag);
      set_key(*voltage, "signal", SamplingFacts::kVoltage);
      set_key(*voltage, "form", form);
      set_key(*voltage, "lag_s", later);
      Fit joined = fitter_.refine(with(others, voltage), Fitter::Until::kArrived);
      const double most = same ? kAsGood : 1;  // of the held-out error
      if (!joined.valid || joined.rss_held_out > most * before.rss_held_out ||
          (!same && joined.rss > before.rss) || (form > 0 && joined.rss > fit_.rss))
        continue;
      if (say_) say_("  late angle and currents: a late voltage");
      fit_ = std::move(joined);
      changed_ = true;
    }
  }

  void restart_slow(std::size_t m, const char* key) {
    const Record& record = fitter_.chain().equations().record();
    if (get_key(*fit_.members[m], key) < record.t.back() - record.t.front()) return;
    for (const TracedKey& traced : fit_.members[m]->tracing().traced_keys()) {
      if (std::string_view(traced.key) != key) continue;
      for (double start : traced.grid) {
        Members others = with(fit_.members, nullptr);
        set_key(*others[m], key, start);
        Fit other = fitter_.refine(std::move(others), Fitter::Until::kArrived);
        if (!other.valid || score_of(fitter_, other) >= score_of(fitter_, fit_)) continue;
        fit_ = std::move(other);
        changed_ = true;
      }
    }
  }

  // A drift that was over before the record began is a constant change. A drift much slower than
  // the record may be the result of effects that were missing in the model then, so it is fitted
  // again from each start.
  void forget_time_constants() {
    constexpr double kAsGood = 10;  // of the score
    for (std::size_t m = 0; m < fit_.members.size(); ++m) {
      const std::vector<NumericKey> keys = numeric_keys(*fit_.members[m]);
      const char* const key = "time_constant_s";
      if (std::none_of(keys.begin(), keys.end(),
                       [&](const NumericKey& k) { return k.key == key && k.value > 0; }))
        continue;
      restart_slow(m, key);
      Members others = with(fit_.members, nullptr);
      set_key(*others[m], key, 0);
      Fit other = fitter_.refine(std::move(others));
      if (!other.valid || score_of(fitter_, other) > score_of(fitter_, fit_) + kAsGood) continue;
      fit_ = std::move(other);
      changed_ = true;
    }
  }

  // A step at the very beginning of the record is a constant load.
  void forget_first_moment() {
    constexpr double kBeginning_s = 0.03;
    const double begin = fitter_.chain().equations().record().t.front();
    Members members = with(fit_.members, nullptr);
    for (auto& m : members) {
      const Traits::Reading* reading = reading_of(*m, Traits::Reading::kFromTheBeginning);
      if (!reading || get_key(*m, "time_s") > begin + kBeginning_s) continue;
      if (std::any_of(members.begin(), members.end(),
                      [&](const auto& other) { return other->kind() == reading->kind; }))
        return;
      m = read_as(*m, *reading, fitter_.chain().equations().facts()).effect;
      Fit always = fitter_.refine(std::move(members));
      if (!always.valid) return;
      fit_ = std::move(always);
      changed_ = true;
      return;
    }
  }

  // A gap was found before later effects. Its keys may be in a local minimum beside the true one,
  // in which an inertia helps. So it is searched again near its keys with all other effects known,
  // also without that inertia.
  void follow_impacts() {
    constexpr double kErrorRatio = 0.8, kSimpler = 0.98;  // of the residual torque before
    const Members& now = fit_.members;
    const auto gap =
        std::find_if(now.begin(), now.end(), [](const auto& m) { return has_gap(*m); });
    if (gap == now.end() || !leaves_more_than_noise(fitter_, fit_)) return;
    Members others = with(now, nullptr, static_cast<std::size_t>(gap - now.begin()));
    const std::shared_ptr<Effect> shaft = (*gap)->clone();
    Fit best;
    const double before = torque_energy(fitter_, fit_);
    double least = kErrorRatio * before;
    for (bool look = true; look;) {
      Fit near = search_closer(fitter_, fitter_.start(others), *shaft);
      const double left = torque_energy(fitter_, near);
      if (say_) say_(fmt::format("  impacts simulated again leave {:.3g}", left / before));
      if (near.valid && rings(*near.members.back()) && left < least) {
        least = left;
        best = std::move(near);
      }
      look = std::erase_if(others,
                           [](const auto& m) { return is_of(*m, Traits::Family::kInertia); }) > 0;
      if (look && best.members.empty()) least = kSimpler * before;
    }
    if (best.members.empty()) return;
    fit_ = std::move(best);
    changed_ = true;
  }

  // A drop of the switches whose threshold is too small is the slope alone: a resistance. The score
  // does not decide it, because the drop's columns follow the noise around zero current.
  void drop_threshold(std::size_t m) {
    const DriveFacts& facts = fitter_.chain().equations().facts();
    const Traits::Reading* slope = reading_of(*fit_.members[m], Traits::Reading::kItsSlope);
    if (!slope || std::any_of(fit_.members.begin(), fit_.members.end(),
                              [&](const auto& other) { return other->kind() == slope->kind; }))
      return;
    const std::shared_ptr<Effect> threshold = fit_.members[m]->clone();
    set_key(*threshold, slope->keys.begin()->from, 0);
    if (threshold->tracing().materiality(facts) >= 1) return;
    Members members = with(fit_.members, nullptr);
    members[m] = read_as(*members[m], *slope, facts).effect;
    Fit alone = fitter_.refine(std::move(members), Fitter::Until::kArrived);
    if (!alone.valid) return;
    if (say_) say_(fmt::format("  a {} without a threshold", slope->kind));
    fit_ = std::move(alone);
    changed_ = true;
  }

  void close_gap(std::size_t m) {
    Members members = with(fit_.members, nullptr);
    members[m] = read_as(*members[m], *reading_of(*members[m], Traits::Reading::kWithoutGap),
                         fitter_.chain().equations().facts())
                     .effect;
    Fit closed = fitter_.refine(std::move(members), Fitter::Until::kArrived);
    if (!closed.valid) return;
    if (say_) say_("  a shaft without a gap");
    fit_ = std::move(closed);
    changed_ = true;
  }

  // Drops effects that have become too small beside later ones. The size of a shaft is not that of
  // one key, but a shaft with too small a gap becomes one without a gap.
  void drop_immaterial() {
    const DriveFacts& facts = fitter_.chain().equations().facts();
    ShaftFacts shaft;
    for (std::size_t m = 0; m < fit_.members.size(); ++m) drop_threshold(m);
    for (std::size_t m = 0; m < fit_.members.size();) {
      const Effect& member = *fit_.members[m];
      const bool small = member.tracing().materiality(facts) < 1,
                 is_shaft = member.describe_shaft(shaft);
      if (small && has_gap(member)) close_gap(m);  // which replaces the member
      if (!small || is_shaft) {
        ++m;
        continue;
      }
      Fit without = fitter_.refine(with(fit_.members, nullptr, m), Fitter::Until::kArrived);
      if (!without.valid) {
        ++m;
        continue;
      }
      if (say_) say_(fmt::format("  without {}: too small", fit_.members[m]->kind()));
      fit_ = std::move(without);
      changed_ = true;
      m = 0;
    }
  }

  // A shaft can represent a gap whose impacts could not be fitted. An inertia beside it then only
  // corrects a little of the impacts' residual.
  void drop_inertia_of_impacts() {
    constexpr double kMends = 2;  // times the residual with it
    const Fit& fit = fit_;
    const bool torsion = std::any_of(fit.members.begin(), fit.members.end(), [](const auto& m) {
      return is_placed(*m, Traits::Place::kShaft);
    });
    if (!torsion || !leaves_more_than_noise(fitter_, fit)) return;
    for (std::size_t m = 0; m < fit.members.size(); ++m) {
      if (!is_of(*fit.members[m], Traits::Family::kInertia)) continue;
      Fit without = fitter_.refine(with(fit.members, nullptr, m), Fitter::Until::kArrived);
      const double left = torque_energy(fitter_, without) / torque_energy(fitter_, fit);
      if (say_) say_(fmt::format("  without inertia {:.3g} of the torque is left", left));
      if (!without.valid || left > kMends) return;
      fit_ = std::move(without);
      changed_ = true;
      return;
    }
  }

  const Fitter& fitter_;
  const Say& say_;
  Fit fit_;
  bool changed_ = false;
};

}  // namespace

Settled settle(const Fitter& fitter, Fit fit, const Say& say) {
  return Settler(fitter, std::move(fit), say)();
}

}  // namespace twinrate
