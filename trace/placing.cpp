#include "trace/placing.hpp"

#include "trace/keys.hpp"

namespace twinrate {
namespace {

constexpr double kRough = 1.15;  // of a row's power: more is not noise

// Backlash with the other members of `now`, not refined.
Fit followed(const Fitter& fitter, const Fit& now, const std::shared_ptr<Effect>& gap) {
  if (gap->prepare(fitter.chain().equations().facts()).empty())
    return fitter.start(with(now.members, gap));
  Fit impossible;
  impossible.rss = 1e300;
  return impossible;
}

}  // namespace

std::shared_ptr<Effect> placed(const Fitter& fitter, const Fit& now,
                               const std::shared_ptr<Effect>& effect) {
  if (effect->kind() != "load_step") return effect;
  std::shared_ptr<Effect> best = effect;
  const Chain& chain = fitter.chain();
  for (double step = 0.02; step > 2e-4; step /= 5) {
    std::vector<Candidate> moments;
    const double t = get_key(*best, "time_s");
    for (int j = -6; j <= 6; ++j) {
      Candidate moment{.effect = best->clone(), .columns = {}};
      set_key(*moment.effect, "time_s", t + j * step);
      for (const Sampled& x : chain.columns(*moment.effect))
        moment.columns.push_back(chain.regressor(x));
      moments.push_back(std::move(moment));
    }
    double gain = -1e300;
    for (const Score& s : score_all(fitter, now, moments))
      if (s.effect && s.gain > gain) gain = s.gain, best = s.effect;
  }
  return best;
}

Fit search_backlash(const Fitter& fitter, const Fit& now, const Fit& shaft) {
  if (shaft.rss < kRough * static_cast<double>(fitter.training().count(shaft.y))) return shaft;
  const Effect& torsion = *shaft.members.back();
  Fit best;
  best.rss = 1e300;
  const auto try_gap = [&](const std::shared_ptr<Effect>& gap) {
    Fit fit = followed(fitter, now, gap);
    if (fit.rss < best.rss) best = std::move(fit);
  };
  for (double gap : {0.005, 0.01, 0.017, 0.025})
    for (double stiffer : {1.0, 2.0, 4.0})
      for (double share : {0.7, 1.0}) {
        const auto effect = make_effect("backlash");
        set_key(*effect, "J_load_kgm2", share * get_key(torsion, "J_load_kgm2"));
        set_key(*effect, "stiffness_Nm_rad", stiffer * get_key(torsion, "stiffness_Nm_rad"));
        set_key(*effect, "damping_Nms_rad", get_key(torsion, "damping_Nms_rad"));
        set_key(*effect, "gap_rad", gap);
        try_gap(effect);
      }
  if (best.members.empty()) return shaft;
  for (double step = 0.2; step > 0.004; step /= 2)
    for (int round = 0; round < 2; ++round)
      for (const char* key : {"gap_rad", "J_load_kgm2", "stiffness_Nm_rad", "damping_Nms_rad"})
        for (double factor : {1 + step, 1 / (1 + step)}) {
          const auto moved = best.members.back()->clone();
          set_key(*moved, key, factor * get_key(*moved, key));
          try_gap(moved);
        }
  return fitter.refine(best.members, 2);
}

}  // namespace twinrate
