#include "trace/effect_view.hpp"

#include <algorithm>

namespace twinrate {
namespace {

constexpr double kNothing = 1e-12;  // of the residual's square: rounding

std::vector<double> as_vector(const Eigen::VectorXd& x) {
  return {x.data(), x.data() + x.size()};
}

void add_view(const char* channel, const std::vector<double>& without,
              const std::vector<double>& with, const Runs& runs, const Sampler& sampler,
              std::vector<EffectView>& views) {
  if (without.empty() || runs.row.empty()) return;
  const Eigen::VectorXd e = sampler(without, runs);
  const Eigen::VectorXd share = e - sampler(with, runs);
  if (share.squaredNorm() <= kNothing * e.squaredNorm()) return;
  views.push_back({channel, as_vector(e), as_vector(share)});
}

}  // namespace

void add_effect_views(const Chain& chain, const Fit& fit, TraceResult& result) {
  if (fit.members.empty()) return;
  const Channels with = chain.equations().residual(fit.effects());
  const Sampler& sampler = chain.sampler();
  const auto fill = [&](TracedEffect& traced) {
    Effects others = fit.effects();
    const auto own = std::find(others.begin(), others.end(), traced.effect);
    if (own == others.end()) return;
    others.erase(own);
    const Channels without = chain.equations().residual(others);
    add_view("d", without.d, with.d, sampler.electrical(), sampler, traced.views);
    add_view("q", without.q, with.q, sampler.electrical(), sampler, traced.views);
    add_view("torque", without.torque, with.torque, sampler.torque(), sampler, traced.views);
  };
  for (TracedEffect& traced : result.effects) fill(traced);
  for (TracedEffect& traced : result.stop_gaps) fill(traced);
}

}  // namespace twinrate
