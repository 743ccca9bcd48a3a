#include "trace/search.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "trace/health.hpp"

namespace twinrate {
namespace {

constexpr double kCoarseMargin = 100;
constexpr double kLost = 0.01;  // share of lost rows that doubles the margin
constexpr int kMostRounds = 8;  // of a noise model and a selection of one effect
constexpr double kSame = 0.9;   // a noise level that fell by less counts as unchanged

// Product of the standard deviations of the channels' innovations.
double level(const NoiseModel& noise) {
  double product = 1;
  for (const Whitener* w : {&noise.d, &noise.q, &noise.torque})
    if (w->sigma() > 0) product *= w->sigma();
  return product;
}

bool same_scales(const NoiseModel& a, const NoiseModel& b) {
  constexpr double kSameScale = 0.1;
  const auto same = [](double x, double y) { return std::abs(x / y - 1) < kSameScale; };
  return same(a.scale_d, b.scale_d) && same(a.scale_q, b.scale_q) &&
         same(a.scale_torque, b.scale_torque);
}

// True if an effect found so far makes the sensors' noise far larger than the whitening assumes. A
// dead time does so at small currents, on an axis on which it was not visible before.
bool louder(const Chain& chain, const Sampled& y) {
  constexpr double kTimes = 2;  // in power
  const Sampled w = chain.whitened(y);
  const auto power = [](const Eigen::VectorXd& noise) {
    return noise.squaredNorm() / std::max(1.0, static_cast<double>(noise.size()));
  };
  return std::max(power(w.noise_d), power(w.noise_q)) > kTimes;
}

// 0 if the currents cover many steps of the converter, 1 if they cover two (rms).
double few_steps(const Record& record, double i_lsb) {
  constexpr double kLeast = 1.0 / 16;
  double sum = 0;
  for (const Vec2& i : record.i_alphabeta) sum += i.squaredNorm();
  const double rows = static_cast<double>(std::max<std::size_t>(1, record.i_alphabeta.size()));
  return 4 * i_lsb * i_lsb / std::max(sum / rows, kLeast * i_lsb * i_lsb);
}

}  // namespace

double margin_of(const Record& record, const Health& health, const DriveFacts& facts) {
  // The error of a coarse ADC is no noise: it repeats with the current, the more so, the fewer
  // steps the current covers. The error of filling lost rows is no noise either.
  return health.coarse(facts.machine.i_rated)
             ? kCoarseMargin * (1 + few_steps(record, health.i_lsb))
             : Fitter::kMargin * (1 + health.not_read() / kLost);
}

Search::Search(DriveProblem& problem, double margin, const Say& say)
    : problem_(problem),
      margin_(margin),
      say_(say),
      laps_(say),
      dictionary_{.sampled = make_candidates(problem.seen()), .whitened = {}},
      fitting_(problem.seen().sampler(), false),
      choosing_(problem.seen().sampler(), true) {
  laps_("candidates");
}

Fitter Search::fitter() const {
  Fitter f(problem_.seen(), fitting_, choosing_);
  f.set_margin(margin_);
  f.leave_out(left_out_);
  return f;
}

void Search::renew_noise(bool first) {
  Chain& chain = problem_.seen();
  const Effects so_far = fit_.effects();
  const bool renewed = dictionary_.renew(chain, so_far);
  const Sampled left = chain.residual(so_far);
  NoiseModel noise = fit_noise_(chain, left, dictionary_);
  const bool anew = first || level(noise) < kSame * level(chain.noise()) || louder(chain, left);
  // Share of the sensors' noise beside the effects found so far: a dead time amplifies that noise.
  const bool other = !anew && !same_scales(noise, chain.noise());
  if (anew) {
    chain.set_noise(std::move(noise));
  } else if (other) {
    NoiseModel scaled = chain.noise();
    scaled.scale_d = noise.scale_d;
    scaled.scale_q = noise.scale_q;
    scaled.scale_torque = noise.scale_torque;
    chain.set_noise(std::move(scaled));
  }
  if (anew || renewed || other) dictionary_.whiten(chain, !anew && !other);
  if (anew && say_)
    say_(fmt::format("noise {:.4g} {:.4g} V, {:.4g} Nm", chain.noise().d.rms(),
                     chain.noise().q.rms(), chain.noise().torque.rms()));
}

// The noise model contains what an effect leaves that is missing, and weighs the equations by it: a
// saturation whose part in the d voltage counted as noise was 5 % too weak by the q voltage, and
// refused for its held-out error. Of an inductance more noise was subtracted than the held-out rows
// have, and a saturation of a smaller gain was added in its place. So a large gain is asked once
// more beside the noise that the newcomer leaves.
bool Search::helps_under_its_noise(Fit refused) {
  Chain& chain = problem_.seen();
  const NoiseModel noise = chain.noise();
  Fit before = std::exchange(fit_, std::move(refused));
  renew_noise(true);
  const Fitter f = fitter();
  const Fit without = f.refine(before.members);
  Fit with = f.refine(std::move(fit_.members));
  const bool helps =
      score_of(f, with) + f.margin() < score_of(f, without) && acceptable(f, with, without);
  if (say_)
    say_(fmt::format("  {} beside its own noise: score {:.0f}, held-out {:.0f} -> {:.0f}{}",
                     with.members.back()->kind(), score_of(f, without) - score_of(f, with),
                     without.rss_held_out, with.rss_held_out, helps ? "" : " (refused)"));
  fit_ = std::move(helps ? with : before);
  if (helps) return true;
  dictionary_.renew(chain, fit_.effects());
  chain.set_noise(noise);
  dictionary_.whiten(chain, false);
  return false;
}

Selection Search::operator()(Fit found) {
  fit_ = std::move(found);
  RoundState state;
  for (int round = 0; state.added && round < kMostRounds; ++round, ++rounds_) {
    renew_noise(round == 0);
    laps_("noise");
    Fit selected = select_one(fitter(), dictionary_.whitened, fit_.members, say_, state);
    if (!state.added) fit_ = selected;
    const auto helps = [&](Fit& refused) { return helps_under_its_noise(std::move(refused)); };
    if (std::any_of(state.refused.begin(), state.refused.end(), helps))
      state.added = true;
    else if (state.added)
      fit_ = std::move(selected);
    noise_of_fit_ = problem_.seen().noise();
    laps_("selection");
  }
  Selection selection = judge(fitter(), dictionary_.whitened, fit_.members, say_);
  laps_("judgement");
  problem_.share_noise();
  return selection;
}

Selection Search::so_far() {
  if (rounds_ == 0) throw TraceStopped{};
  problem_.set_noise(noise_of_fit_);
  return not_judged(std::move(fit_), rounds_);
}

}  // namespace twinrate
