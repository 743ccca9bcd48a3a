#include "trace/selection.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "trace/keys.hpp"
#include "trace/lines.hpp"

namespace twinrate {
namespace {

constexpr std::size_t kMostMembers = 12;
constexpr std::size_t kMostTried = 3;  // kinds refined at each step
constexpr double kRough = 1.15;        // of a row's power: more is not noise
constexpr double kSupport = 0.3;       // of a gain, that the error itself must show
constexpr double kNear = 0.85;         // of the best gain: still worth refining

using Members = std::vector<std::shared_ptr<Effect>>;

bool may_repeat(std::string_view kind) {
  for (std::string_view k :
       {"cogging", "flux_harmonics", "load_step", "signal_lag", "periodic_torque"})
    if (kind == k) return true;
  return false;
}

// The same effect at the same place, or another form of one that is there only once.
bool taken(const Fit& fit, const Effect& effect) {
  for (const auto& m : fit.members) {
    if (m->kind() != effect.kind()) continue;
    if (!may_repeat(effect.kind())) return true;
    if (effect.kind() == "load_step" || effect.kind() == "periodic_torque") continue;
    const char* key = effect.kind() == "signal_lag" ? "signal" : "order";
    if (get_key(*m, key) == get_key(effect, key)) return true;
  }
  return false;
}

std::size_t parameters_of(const Effect& effect) {
  auto count = static_cast<std::size_t>(effect.regressor_count());
  for (const TracedKey& key : effect.traced_keys())
    if (!key.linear || effect.regressor_count() == 0) ++count;
  return count;
}

Members with(const Members& members, const std::shared_ptr<Effect>& newcomer,
             std::size_t left_out) {
  Members all;
  for (std::size_t m = 0; m < members.size(); ++m)
    if (m != left_out) all.push_back(members[m]->clone());
  if (newcomer) all.push_back(newcomer->clone());
  return all;
}
constexpr std::size_t kNobody = static_cast<std::size_t>(-1);

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

class Selector {
 public:
  Selector(const Fitter& fitter, const std::vector<Candidate>& candidates, const Say& say)
      : fitter_(fitter), candidates_(candidates), say_(say) {}

  Fit step(const Members& members) {
    selection_.fit = fitter_.refine(members);
    drop_superfluous();
    if (selection_.fit.members.size() < kMostMembers && add_one()) drop_superfluous();
    return std::move(selection_.fit);
  }
  Selection finish(const Members& members) {
    selection_.fit = fitter_.refine(members);
    for (int round = 0; round < 2 && swap_one(); ++round) drop_superfluous();
    judge_members();
    return std::move(selection_);
  }
  bool added() const { return added_; }

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

  // A gap looks like a soft shaft until the load mass is followed through it. Its impacts make the
  // error rough in the parameters: backlash is searched around the shaft that was found, first on
  // a grid, then along one parameter after the other in ever smaller steps.
  void try_backlash(const Fit& now, Fit& best) const {
    const double rows = static_cast<double>(fitter_.training().count(best.y));
    if (best.rss < kRough * rows) return;  // a shaft explains it all
    static constexpr const char* kKeys[] = {"gap_rad", "J_load_kgm2", "stiffness_Nm_rad",
                                            "damping_Nms_rad"};
    const Effect& shaft = *best.members.back();
    const auto fit_of = [&](const std::shared_ptr<Effect>& gap) {
      Fit fit;
      if (!gap->prepare(fitter_.chain().equations().facts()).empty()) {
        fit.rss = 1e300;
        return fit;
      }
      return fitter_.start(with(now.members, gap, kNobody));
    };
    Fit found;
    found.rss = 1e300;
    for (double gap : {0.005, 0.01, 0.017, 0.025})
      for (double stiffer : {1.0, 2.0, 4.0})
        for (double share : {0.7, 1.0}) {
          const auto effect = make_effect("backlash");
          set_key(*effect, "J_load_kgm2", share * get_key(shaft, "J_load_kgm2"));
          set_key(*effect, "stiffness_Nm_rad", stiffer * get_key(shaft, "stiffness_Nm_rad"));
          set_key(*effect, "damping_Nms_rad", get_key(shaft, "damping_Nms_rad"));
          set_key(*effect, "gap_rad", gap);
          Fit fit = fit_of(effect);
          if (fit.rss < found.rss) found = std::move(fit);
        }
    for (double step = 0.2; step > 0.004; step /= 2)
      for (int round = 0; round < 2; ++round)
        for (const char* key : kKeys)
          for (double factor : {1 + step, 1 / (1 + step)}) {
            const auto moved = found.members.back()->clone();
            set_key(*moved, key, factor * get_key(*moved, key));
            Fit fit = fit_of(moved);
            if (fit.rss < found.rss) found = std::move(fit);
          }
    found = fitter_.refine(found.members, 2);
    if (say_)
      say_(fmt::format("  {}: score {:.0f} against {:.0f} of a shaft",
                       describe(*found.members.back()), score_of(fitter_, found),
                       score_of(fitter_, best)));
    if (acceptable(found, now) && score_of(fitter_, found) < score_of(fitter_, best))
      best = std::move(found);
  }

  // A moment is searched more and more finely before it is refined: the residual is flat away from
  // it.
  std::shared_ptr<Effect> placed(const Fit& now, const std::shared_ptr<Effect>& effect) const {
    if (effect->kind() != "load_step") return effect;
    std::shared_ptr<Effect> best = effect;
    const Chain& chain = fitter_.chain();
    for (double step = 0.02; step > 2e-4; step /= 5) {
      std::vector<Candidate> moments;
      const double t = get_key(*best, "time_s");
      for (int j = -6; j <= 6; ++j) {
        Candidate moment{.effect = best->clone(), .columns = {}};
        set_key(*moment.effect, "time_s", t + j * step);
        for (const Sampled& x : chain.columns(*moment.effect))
          moment.columns.push_back(chain.whitened(x));
        moments.push_back(std::move(moment));
      }
      double gain = -1e300;
      for (const Score& s : score_all(fitter_, now, moments))
        if (s.effect && s.gain > gain) gain = s.gain, best = s.effect;
    }
    return best;
  }

  bool acceptable(const Fit& next, const Fit& now) const {
    return next.valid && next.rss_held_out < now.rss_held_out && supported(next, now) &&
           next.members.back()->materiality(fitter_.chain().equations().facts()) >= 1;
  }

  bool add_one() {
    const Fit& now = selection_.fit;
    const double score_now = score_of(fitter_, now);
    Fit best;
    double best_gain = 0, first_gain = 0;
    std::size_t tried = 0;
    for (const Score& s : ranked(now)) {
      if (s.gain <= 0 || tried >= kMostTried + (best.members.empty() ? 2 : 0)) break;
      if (!best.members.empty() && s.gain < kNear * first_gain) break;
      ++tried;
      Fit next = fitter_.refine(with(now.members, placed(now, s.effect), kNobody));
      const double gain = score_now - score_of(fitter_, next);
      const bool good = acceptable(next, now);
      if (say_)
        say_(fmt::format("  {} -> {}: score {:.0f} -> {:.0f}, held-out {:.0f} -> {:.0f}{}",
                         describe(*s.effect), describe(*next.members.back()), s.gain, gain,
                         now.rss_held_out, next.rss_held_out, good ? "" : " (refused)"));
      if (gain <= 0 || !good) {
        selection_.refused.push_back({std::string(s.effect->kind()), gain,
                                      1 - next.rss_held_out / now.rss_held_out,
                                      refusal(next, now, gain)});
        continue;
      }
      first_gain = std::max(first_gain, s.gain);
      if (gain > best_gain) {
        best_gain = gain;
        best = std::move(next);
      }
    }
    if (best.members.empty()) return false;
    if (best.members.back()->kind() == "torsion") try_backlash(now, best);
    selection_.fit = std::move(best);
    return added_ = true;
  }

  // The held-out error itself has to fall, not only what is left of it beside its noise.
  static bool supported(const Fit& next, const Fit& now) {
    return now.raw_held_out - next.raw_held_out > kSupport * (now.rss_held_out - next.rss_held_out);
  }

  std::string refusal(const Fit& next, const Fit& now, double gain) const {
    if (!next.valid) return "its parameters leave their physical range";
    if (gain <= 0) return "does not pay for its parameters on the training blocks";
    if (next.rss_held_out >= now.rss_held_out) return "does not help on the held-out blocks";
    if (!supported(next, now)) return "only its noise changes on the held-out blocks";
    return "smaller than what is worth reporting";
  }

  void drop_superfluous() {
    for (std::size_t m = 0;
         selection_.fit.members.size() > 1 && m < selection_.fit.members.size();) {
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

  // Puts one other kind in the place of a member where that is better.
  bool swap_one() {
    for (std::size_t m = 0; m < selection_.fit.members.size(); ++m) {
      const Fit without = fitter_.refine(with(selection_.fit.members, nullptr, m));
      const double gain_now = score_of(fitter_, without) - score_of(fitter_, selection_.fit);
      std::size_t tried = 0;
      for (const Score& s : ranked(without)) {
        if (s.gain < 0.5 * gain_now || tried >= kMostTried) break;
        if (s.effect->kind() == selection_.fit.members[m]->kind()) continue;
        ++tried;
        Fit next = fitter_.refine(with(without.members, s.effect, kNobody));
        const double gain = score_of(fitter_, without) - score_of(fitter_, next);
        if (gain <= gain_now + 1 || !acceptable(next, without)) continue;
        if (say_)
          say_(fmt::format("  {} in place of {}: {:.0f} against {:.0f}", s.effect->kind(),
                           selection_.fit.members[m]->kind(), gain, gain_now));
        selection_.fit = std::move(next);
        return true;
      }
    }
    return false;
  }

  void judge_members() {
    selection_.members.clear();
    for (std::size_t m = 0; m < selection_.fit.members.size(); ++m) {
      Selected s{.without = fitter_.refine(with(selection_.fit.members, nullptr, m))};
      s.score_gain = score_of(fitter_, s.without) - score_of(fitter_, selection_.fit);
      s.held_out_gain = 1 - selection_.fit.rss_held_out / s.without.rss_held_out;
      std::size_t tried = 0;
      for (const Score& other : ranked(s.without)) {
        if (tried >= kMostTried) break;
        if (other.effect->kind() == selection_.fit.members[m]->kind()) continue;
        ++tried;
        Alternative a{std::string(other.effect->kind()), other.gain, 0, ""};
        if (other.gain > 0.5 * s.score_gain) {
          const Fit next = fitter_.refine(with(s.without.members, other.effect, kNobody));
          a.score_gain = score_of(fitter_, s.without) - score_of(fitter_, next);
          a.held_out_gain = 1 - next.rss_held_out / s.without.rss_held_out;
          if (!next.valid) a.why = "its parameters leave their physical range";
        }
        if (a.why.empty()) a.why = "explains less";
        s.alternatives.push_back(std::move(a));
      }
      selection_.members.push_back(std::move(s));
    }
  }

  const Fitter& fitter_;
  const std::vector<Candidate>& candidates_;
  const Say& say_;
  Selection selection_;
  bool added_ = false;
};

}  // namespace

double score_of(const Fitter& fitter, const Fit& fit) {
  const double N = static_cast<double>(fitter.training().count(fit.y));
  std::size_t k = 0;
  for (const auto& m : fit.members) k += parameters_of(*m);
  return N * std::log(fit.rss) + static_cast<double>(k) * std::log(N) +
         fitter.margin() * static_cast<double>(fit.members.size());
}

std::vector<Score> score_all(const Fitter& fitter, const Fit& fit,
                             const std::vector<Candidate>& candidates) {
  const Rows& rows = fitter.training();
  const DriveFacts& facts = fitter.chain().equations().facts();
  const auto P = static_cast<Eigen::Index>(fit.J.size());
  NormalEquations own{Eigen::MatrixXd(P, P), Eigen::VectorXd(P), Eigen::VectorXd(P)};
  for (Eigen::Index a = 0; a < P; ++a) {
    for (Eigen::Index c = 0; c <= a; ++c) own.A(a, c) = own.A(c, a) = rows.dot(fit.J[a], fit.J[c]);
    own.b[a] = rows.dot(fit.J[a], fit.y);
    own.noise[a] = rows.noise(fit.J[a], fit.J[a]);
  }
  const double N = static_cast<double>(rows.count(fit.y));
  std::vector<Score> scores(candidates.size());
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    const Candidate& candidate = candidates[i];
    if (taken(fit, *candidate.effect)) continue;
    const auto g = static_cast<Eigen::Index>(candidate.columns.size());
    NormalEquations normal{Eigen::MatrixXd(P + g, P + g), Eigen::VectorXd(P + g),
                           Eigen::VectorXd(P + g)};
    normal.A.topLeftCorner(P, P) = own.A;
    normal.b.head(P) = own.b;
    normal.noise.head(P) = own.noise;
    for (Eigen::Index c = 0; c < g; ++c) {
      const Sampled& x = candidate.columns[c];
      for (Eigen::Index a = 0; a < P; ++a)
        normal.A(a, P + c) = normal.A(P + c, a) = rows.dot(fit.J[a], x);
      for (Eigen::Index e = 0; e <= c; ++e)
        normal.A(P + e, P + c) = normal.A(P + c, P + e) = rows.dot(candidate.columns[e], x);
      normal.b[P + c] = rows.dot(x, fit.y);
      normal.noise[P + c] = rows.noise(x, x);
    }
    const std::vector<char> use = normal.usable(N);
    if (std::none_of(use.begin() + P, use.end(), [](char u) { return u != 0; })) continue;
    const Eigen::VectorXd x = normal.solve(use);
    double noise_change = 0;
    for (Eigen::Index c = 0; c < g; ++c) {
      const Sampled& column = candidate.columns[c];
      noise_change -= 2 * x[P + c] * rows.noise(column, fit.y);
      for (Eigen::Index e = 0; e < g; ++e)
        noise_change += x[P + c] * x[P + e] * rows.noise(column, candidate.columns[e]);
    }
    const double rss =
        fit.rss - 2 * x.dot(normal.b) + x.dot(normal.A * x) + kNoiseDoubt * std::abs(noise_change);
    if (!(rss > 0)) continue;
    Score& score = scores[i];
    score.effect = candidate.effect->clone();
    if (candidate.effect->regressor_count() > 0) {
      const Eigen::VectorXd sigma = normal.inverse(use).diagonal().tail(g).cwiseMax(0).cwiseSqrt();
      score.effect->set_coefficients(std::vector<double>(sigma.data(), sigma.data() + g));
      score.sigma_in_sizes = score.effect->materiality(facts);
      score.effect->set_coefficients(std::vector<double>(x.data() + P, x.data() + P + g));
    } else if (score.effect->kind() == "signal_lag") {
      set_key(*score.effect, "lag_s", x[P] * get_key(*score.effect, "lag_s"));
      if (x[P] <= 0) continue;
    } else if (x[P] < 0.1 || x[P] > 8) {
      continue;  // far from this point of the grid
    }
    score.valid = within_ranges(*score.effect) && score.effect->materiality(facts) >= 0.5;
    const auto k = static_cast<double>(parameters_of(*candidate.effect));
    score.gain = N * std::log(fit.rss / rss) - k * std::log(N) - fitter.margin();
  }
  return scores;
}

Fit select_one(const Fitter& fitter, const std::vector<Candidate>& candidates,
               const std::vector<std::shared_ptr<Effect>>& members, const Say& say, bool& added) {
  Selector selector(fitter, candidates, say);
  Fit fit = selector.step(members);
  added = selector.added();
  return fit;
}

Selection judge(const Fitter& fitter, const std::vector<Candidate>& candidates,
                const std::vector<std::shared_ptr<Effect>>& members, const Say& say) {
  return Selector(fitter, candidates, say).finish(members);
}

}  // namespace twinrate
