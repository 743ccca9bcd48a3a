#include "trace/residual_structure.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <string_view>

#include "model/effects/catalogue.hpp"
#include "model/effects/materiality.hpp"
#include "trace/doubts.hpp"
#include "trace/keys.hpp"
#include "trace/statistics.hpp"
#include "trace/torque_over_sensors.hpp"
#include "trace/transfer.hpp"

namespace twinrate {
namespace {

constexpr int kBins = 24;
constexpr double kSmallestVoltage = 2e-4;    // of the bus voltage
constexpr double kSmallestTorque_Nm = 6e-3;  // of a drive of 8 Nm
constexpr double kChance = 1e-9;             // probability that noise makes such means
constexpr double kLeastBesideShaft = 0.15;   // a model never meets impacts exactly
constexpr double kTimesNoise = 2;            // ratio of an rms that exceeds the noise
// The same without a claim. Of 299 drawn logs with nothing missing three exceed it.
constexpr double kTimesNoiseAlone = 4;
constexpr double kMostlyMean = 0.8;   // of a structure's share, by design: then no axis is shown
constexpr double kLeastShare = 0.04;  // of the residual's power: a smaller part is not visible

// Reasons why a structure may be no effect.
constexpr const char* kNotConfirmed = "the held-out rows do not confirm it";
constexpr const char* kOfCounts =
    "an angle error of half a count can make twice as much (a finer encoder would decide)";
constexpr const char* kOfNoise = "the sensors' noise has as much energy";
constexpr const char* kOfSpeed =
    "at constant speed the rounding of the angle repeats, and the controller responds to it";
// Of the EMF that half a count makes in the d voltage. Ten drawn logs have such a structure and no
// claim. In the five that lack nothing it is 0.11 to 0.42 of that EMF. In the others it is 0.18 in
// one, and 1.02 or more in four.
constexpr double kOfCount = 0.5;

// True if an axis varies by more than its own noise in most rows. Otherwise noise orders the rows,
// and that noise is in the residual as well. The start of a run at constant load moves i_q by far
// more than noise, but only in the few rows of the start. So the measure is the distance of the
// quartiles, which is 1.35 standard deviations for noise.
bool moves(const std::vector<double>& x, const std::vector<double>& noisier) {
  constexpr double kTimes = 5, kQuarters = 1.349;
  std::vector<double> sorted = x;
  std::sort(sorted.begin(), sorted.end());
  double noise = 0;
  for (std::size_t i = 0; i < x.size(); ++i)
    noise += (noisier[i] - x[i]) * (noisier[i] - x[i]) / static_cast<double>(x.size());
  const double apart = sorted[x.size() * 3 / 4] - sorted[x.size() / 4];
  return apart > kTimes * kQuarters * std::sqrt(noise);
}

struct Axis {
  const char* regressor;
  double (*of)(const OperatingPoint&);
};
constexpr std::string_view kTime = "t";
constexpr Axis kAxes[] = {
    {"t", [](const OperatingPoint& p) { return p.t; }},
    {"theta_m", [](const OperatingPoint& p) { return wrap_turn(p.theta_m); }},
    {"i_d", [](const OperatingPoint& p) { return p.i_dq[0]; }},
    {"i_q", [](const OperatingPoint& p) { return p.i_dq[1]; }},
    {"omega_m", [](const OperatingPoint& p) { return p.omega_m; }},
    {"direction", [](const OperatingPoint& p) { return p.omega_m > 0 ? 1.0 : -1.0; }},
};

// Means over bins of equal count of the rows that do not judge, as a function of the axis.
class BinMeans {
 public:
  BinMeans(const std::vector<double>& x, const std::vector<char>& judges) : x_(x), judges_(judges) {
    std::vector<double> sorted;
    for (std::size_t i = 0; i < x.size(); ++i)
      if (!judges[i]) sorted.push_back(x[i]);
    std::sort(sorted.begin(), sorted.end());
    for (std::size_t b = 1; b < kBins && !sorted.empty(); ++b) {
      const double limit = sorted[sorted.size() * b / kBins];
      if (limits_.empty() || limit > limits_.back()) limits_.push_back(limit);
    }
  }
  std::size_t bins() const { return limits_.size() + 1; }

  // The mean of the bin of each row.
  Eigen::VectorXd of(const Eigen::VectorXd& y) const {
    std::vector<double> sum(bins(), 0.0), count = sum;
    std::vector<std::size_t> bin(x_.size());
    for (std::size_t i = 0; i < x_.size(); ++i) {
      bin[i] = static_cast<std::size_t>(std::upper_bound(limits_.begin(), limits_.end(), x_[i]) -
                                        limits_.begin());
      if (judges_[i]) continue;
      sum[bin[i]] += y[static_cast<Eigen::Index>(i)];
      ++count[bin[i]];
    }
    Eigen::VectorXd mean(y.size());
    for (std::size_t i = 0; i < bin.size(); ++i)
      mean[static_cast<Eigen::Index>(i)] = sum[bin[i]] / std::max(1.0, count[bin[i]]);
    return mean;
  }

 private:
  const std::vector<double>& x_;
  const std::vector<char>& judges_;
  std::vector<double> limits_;
};

// Vote of the judging rows on the means, in eight pieces a block. The size of a piece is half its
// share of the time and half its share of the means' energy, so that a structure in few rows has
// pieces there.
Votes transfer_of(const Eigen::VectorXd& y, const Eigen::VectorXd& mean,
                  const std::vector<char>& judges) {
  constexpr double kPieces = 192;  // of a record
  double n = 0, said = 1e-300;
  for (std::size_t i = 0; i < judges.size(); ++i)
    if (judges[i]) ++n, said += std::pow(mean[static_cast<Eigen::Index>(i)], 2);
  const double pieces = std::ceil(kPieces * n / static_cast<double>(judges.size()));
  Pieces without, with;
  double so_far = 0;
  for (std::size_t i = 0; i < judges.size(); ++i) {
    if (!judges[i]) continue;
    const auto k = static_cast<Eigen::Index>(i);
    const std::pair<int, std::size_t> piece{0, static_cast<std::size_t>(pieces * so_far)};
    so_far += 0.5 * (mean[k] * mean[k] / said + 1 / n);
    without[piece] += y[k] * y[k];
    with[piece] += (y[k] - mean[k]) * (y[k] - mean[k]);
  }
  return votes_of(without, with, Criterion{}.silent);
}

// Share of the power of y that the means have, on the rows that do not judge.
double share_of(const Eigen::VectorXd& mean, const Eigen::VectorXd& y,
                const std::vector<char>& judges) {
  double total = 1e-300, explained = 0;
  for (std::size_t i = 0; i < judges.size(); ++i) {
    if (judges[i]) continue;
    const auto k = static_cast<Eigen::Index>(i);
    total += y[k] * y[k];
    explained += mean[k] * mean[k];
  }
  return explained / total;
}

// Share of the power of y, on the rows that do not judge, that the sensors' errors make themselves.
// They are in the axis as well, and in the drive's response to them. The drawn errors are half of
// the actual ones; if y exceeds them, y may be noise that was drawn too small. The factor is half
// as much again, because the drawn share differs from the actual one: with a factor of two, four of
// six runs at 2 kHz that lacked nothing had a structure along i_d, 30 to 33 % of the power. On 200
// drawn logs only one verdict depends on it.
double made_by_sensors(const Eigen::VectorXd& noise, const std::vector<double>& x,
                       const Eigen::VectorXd& y, const std::vector<char>& judges) {
  constexpr double kTimes = 3;
  if (noise.size() != y.size()) return 0;
  const Eigen::VectorXd mean = BinMeans(x, judges).of(noise);
  return kTimes * std::max(share_of(mean, y, judges), share_of(mean, noise, judges));
}

// The same share; 0 if noise makes as much.
double share_by_chance(const Eigen::VectorXd& y, const Eigen::VectorXd& mean,
                       const std::vector<char>& judges, std::size_t bins) {
  const double share = share_of(mean, y, judges),
               rows = static_cast<double>(std::count(judges.begin(), judges.end(), 0));
  return chi_square_tail(share * rows, static_cast<double>(bins)) > kChance ? 0 : share;
}

// The share of one mean for all rows.
double share_of_mean(const Eigen::VectorXd& y, const std::vector<char>& judges) {
  const std::vector<double> same(judges.size(), 0);
  return share_of(BinMeans(same, judges).of(y), y, judges);
}

double root_mean_square(const Eigen::VectorXd& y) {
  return y.norm() / std::sqrt(std::max(1.0, static_cast<double>(y.size())));
}

// True if the votes exceed chance, corrected for the number of axes and channels.
bool transfers(const Votes& votes) {
  constexpr double kLooks = 3 * std::size(kAxes);  // in each channel
  const Criterion criterion;
  return votes.judgement.votes >= criterion.votes &&
         votes.judgement.p_value < criterion.chance / kLooks;
}

// The outputs of the judging blocks; if none judges, every fourth of 24 blocks.
std::vector<char> judging_outputs(const Runs& runs) {
  if (std::count(runs.held_out.begin(), runs.held_out.end(), 1) > 0) return runs.held_out;
  constexpr std::size_t kBlocks = 24, kEvery = 4;
  std::vector<char> judges(runs.row.size());
  for (std::size_t i = 0; i < judges.size(); ++i)
    judges[i] = kBlocks * i / judges.size() % kEvery == kEvery - 1;
  return judges;
}

// One channel of the residual, in which structure is looked for.
struct Looked {
  const char *equation, *channel, *what;
  Eigen::VectorXd Sampled::*value;
  Eigen::VectorXd Sampled::*noise;
  double smallest;  // rms of the means, V or Nm
};

// The axis that explains most of a channel, on the judging rows; share 0 if none exceeds chance and
// the sensors.
class StructureSearch {
 public:
  StructureSearch(const Chain& chain, const Fit& fit, const Sampled& physical)
      : chain_(chain), fit_(fit), physical_(physical) {
    least_ = (has_shaft(fit.members) ? kLeastBesideShaft : kLeastShare) +
             fit.doubt / std::max(1e-300, fit.raw_held_out);
    const Effects claimed = fit.effects();
    counts_may_ = acting_on(claimed, kOnCurrents).empty() && acting_on(claimed, kOnAngle).empty();
  }

  // True if no error of a current or of the angle is claimed. Otherwise the structure may come from
  // it.
  bool counts_may() const { return counts_may_; }
  // The rounding noise of moved counts; computed at the first structure.
  const Sampled& rounding(bool whitened) const {
    if (!rounding_) rounding_ = chain_.rounding(fit_.effects());
    if (!whitened) return *rounding_;
    if (!whitened_) whitened_ = chain_.whitened(*rounding_);
    return *whitened_;
  }

  Structure along_axes(const Looked& looked, const Runs& runs) const {
    Structure best{.doubt = kNotConfirmed};
    if ((fit_.y.*looked.value).size() < 50 * kBins) return best;
    const std::vector<char> judges = judging_outputs(runs);
    for (const Axis& axis : kAxes) {
      const Along found = along(axis, looked, runs, judges);
      if (found.share == 0) continue;
      if (std::pair(!found.doubt, found.share) <= std::pair(best.doubt.empty(), best.share))
        continue;
      best = {.regressor = axis.regressor,
              .share = found.share,
              .equation = looked.equation,
              .channel = looked.channel,
              .doubt = found.doubt ? found.doubt : ""};
      best.text = fmt::format("{} depends on {} ({:.1f} % of its power)", looked.what,
                              axis.regressor, 100 * found.share);
    }
    if (best.share == 0) return best;
    if (const double mean = share_of_mean(fit_.y.*looked.value, judges);
        mean > kMostlyMean * best.share) {
      best.regressor = kTime;
      best.text = fmt::format("{} has another mean than zero ({:.1f} % of its power)", looked.what,
                              100 * mean);
    }
    return best;
  }

 private:
  struct Along {
    double share = 0;
    const char* doubt = nullptr;  // none: confirmed
  };

  Along along(const Axis& axis, const Looked& looked, const Runs& runs,
              const std::vector<char>& judges) const {
    const Eigen::VectorXd &e = fit_.y.*looked.value, &noise = fit_.y.*looked.noise;
    std::vector<double> x, noisier;
    for (std::size_t row : runs.row) {
      x.push_back(axis.of(chain_.equations().points()[row]));
      noisier.push_back(axis.of(chain_.answered().points()[row]));
    }
    if (!moves(x, noisier)) return {};
    const BinMeans means(x, judges);
    if (root_mean_square(means.of(physical_.*looked.value)) < looked.smallest) return {};
    const Eigen::VectorXd mean = means.of(e);
    const double fitted = share_by_chance(e, mean, judges, means.bins());
    const bool alone = fit_.members.empty(), of_time = axis.regressor == kTime;
    const double least = least_ + made_by_sensors(noise, noisier, alone ? e : noise, judges);
    if (fitted < least) return {};
    // Beside a claim the sensors explain all of an error that is smaller than theirs, as in the gate.
    // Without a claim it is in doubt.
    const auto exceeds = [&](const Eigen::VectorXd& errors) {
      return errors.size() == e.size() && errors.norm() > e.norm();
    };
    bool of_noise = exceeds(noise);
    if (of_noise && !alone) return {};
    if (counts_may_) {
      const Eigen::VectorXd& moved = rounding(true).*looked.noise;
      of_noise = of_noise || exceeds(moved);
      if ((of_noise && !alone) ||
          (moved.size() == e.size() &&
           fitted < least_ + made_by_sensors(moved, x, alone ? e : moved, judges)))
        return {};
    }
    const Votes votes = transfer_of(e, mean, judges);
    const double gain = votes.judgement.held_out_gain;
    // Beside a claim any doubt is reported: a wrong kind leaves a structure that few other rows
    // share. If the judging rows contradict it, it is chance. A structure over time has no other
    // rows.
    if (!alone) return {.share = of_time || gain > 0 ? fitted : 0};
    if (!transfers(votes)) return {.share = of_time ? fitted : 0, .doubt = kNotConfirmed};
    const double rms = root_mean_square(means.of(physical_.*looked.value));
    const bool of_counts = rms < kOfCount * emf_of_half_a_count(looked, runs);
    return {.share = gain < least ? 0 : gain,
            .doubt = of_counts       ? kOfCounts
                     : of_noise      ? kOfNoise
                     : repeats(axis) ? kOfSpeed
                                     : nullptr};
  }

  // True for a current or the speed where the speed is constant. They move by the counts alone.
  bool repeats(const Axis& axis) const {
    const std::string_view of = axis.regressor;
    return (of == "i_d" || of == "i_q" || of == "omega_m") &&
           chain_.equations().record().angle.lsb > 0 && at_constant_speed(chain_.equations());
  }

  // Rms of the d voltage from an angle error of half a count. The loop responds to each count, so
  // the product of angle error and voltage need not have the mean zero.
  double emf_of_half_a_count(const Looked& looked, const Runs& runs) const {
    if (looked.value != &Sampled::d || runs.row.empty()) return 0;
    const Equations& equations = chain_.equations();
    const MachineParameters& m = equations.facts().machine;
    double square = 0;
    for (const std::size_t row : runs.row) square += std::pow(equations.points()[row].omega_m, 2);
    return 0.5 * m.n_p * equations.record().angle.lsb * m.n_p * m.psi_f *
           std::sqrt(square / static_cast<double>(runs.row.size()));
  }

  const Chain& chain_;
  const Fit& fit_;
  const Sampled& physical_;
  double least_;
  bool counts_may_;  // they explain a structure
  mutable std::optional<Sampled> rounding_, whitened_;
};

// A torque above the noise of the sensors, on whatever axis. Without a claim a smaller one is only a doubt
// (conclude.cpp).
Structure slow_torque(const Chain& chain, const Sampled& physical, const StructureSearch& search,
                      const Effects& members) {
  const double rms = root_mean_square(physical.torque);
  if (rms <= least_torque(chain.equations().facts())) return {};
  const double least = members.empty() ? kTimesNoiseAlone : kTimesNoise;
  const Eigen::VectorXd of_impacts = chain.impacts_noise(members);
  double over = torque_over_sensors(chain, physical, physical.noise_torque, of_impacts);
  if (over > least && search.counts_may()) {
    const Eigen::VectorXd& rounding = search.rounding(false).noise_torque;
    if (rounding.squaredNorm() > 0)
      over = std::min(over, torque_over_sensors(chain, physical, rounding, of_impacts));
  }
  if (over <= least) return {};
  Structure s{.regressor = "t",
              .share = 1 - 1 / (over * over),
              .equation = "mechanical",
              .channel = "torque"};
  s.text = torque_in_words(rms, over);
  return s;
}

// An intermittent effect (impacts, a load that comes and goes) depends on none of the axes and is
// not present all the time. The noise is at least that of the sensors, which varies between rows.
Structure bursts_of_torque(const Chain& chain, const Sampled& physical,
                           const StructureSearch& search) {
  if (physical.torque.size() == 0) return {};
  const double rms = root_mean_square((physical.torque.array() - physical.torque.mean()).matrix());
  if (rms <= least_torque(chain.equations().facts())) return {};
  double noise = std::max(chain.noise().torque.rms(), root_mean_square(physical.noise_torque));
  if (rms <= kTimesNoise * noise) return {};
  if (search.counts_may())
    noise = std::max(noise, root_mean_square(search.rounding(false).noise_torque));
  if (rms <= kTimesNoise * noise) return {};
  Structure s{.regressor = "t",
              .share = 1 - noise * noise / (rms * rms),
              .equation = "mechanical",
              .channel = "torque",
              .bursts = true};
  s.text = fmt::format("the torque residual comes in bursts ({:.3g} Nm rms, noise {:.3g} Nm)", rms,
                       noise);
  return s;
}

}  // namespace

double least_voltage(const DriveFacts& facts) {
  return kSmallestVoltage * facts.v_dc;
}
double least_torque(const DriveFacts& facts) {
  return smallest_torque(facts, kSmallestTorque_Nm);
}

std::vector<Structure> residual_structure(const Fitter& fitter, const Fit& fit) {
  const Chain& chain = fitter.chain();
  const DriveFacts& facts = chain.equations().facts();
  const Sampled physical = chain.residual(fit.effects());
  const StructureSearch search(chain, fit, physical);
  std::vector<Structure> found;
  const auto keep = [&](Structure s) {
    if (s.share > 0) found.push_back(std::move(s));
  };
  const double smallest_V = least_voltage(facts);
  const Runs& electrical = chain.sampler().electrical();
  keep(search.along_axes({"electrical", "d", "the residual of the d voltage", &Sampled::d,
                          &Sampled::noise_d, smallest_V},
                         electrical));
  keep(search.along_axes({"electrical", "q", "the residual of the q voltage", &Sampled::q,
                          &Sampled::noise_q, smallest_V},
                         electrical));
  keep(search.along_axes({"mechanical", "torque", "the residual of the torque", &Sampled::torque,
                          &Sampled::noise_torque, least_torque(facts)},
                         chain.sampler().torque()));
  const auto gap = [](const auto& member) { return has_gap(*member); };
  if (std::none_of(fit.members.begin(), fit.members.end(), gap))
    keep(bursts_of_torque(chain, physical, search));
  const auto told = [](const Structure& s) { return s.channel == "torque" && s.doubt.empty(); };
  if (std::none_of(found.begin(), found.end(), told))
    keep(slow_torque(chain, physical, search, fit.effects()));
  return found;
}

Structure line_structure(const Effect& effect, const Selected& selected) {
  const double f = get_key(effect, "frequency_Hz"), order = get_key(effect, "order");
  Structure s{.regressor = f > 0 ? "t" : "theta_m",
              .share = selected.held_out_gain,
              .equation = "mechanical",
              .channel = "torque"};
  s.frequency_Hz = f;
  s.order = order;
  const double A = get_key(effect, "amplitude_Nm");
  s.text = f > 0 ? fmt::format("a torque of {:.3g} Nm at {:.4g} Hz in time", A, f)
                 : fmt::format("a torque of {:.3g} Nm of order {:.4g} in the angle", A, order);
  return s;
}

namespace {

using Run = Traits::Run;

const char* text_of(Run run) {
  switch (run) {
    case Run::kTwoBusVoltages:
      return "runs at two bus voltages: dead time's loss is in proportion to v_dc, a device's drop "
             "is not";
    case Run::kUncoupled:
      return "the same run with the load taken off the shaft";
    case Run::kWindingAlone:
      return "the winding's resistance measured at its terminals";
    case Run::kStandstillWithoutVoltage:
      return "a run at standstill without voltage: only the offset of the sensor remains";
    case Run::kFastWithoutLoad:
      return "a faster run without load: there the voltage is mostly EMF";
    case Run::kLoadStepsAndCurrents:
      return "a run with load steps at several speeds and with i_d of both signs";
    case Run::kReversals:
      return "a run with fast speed reversals and one with a slow ramp";
    case Run::kSlowBothWays:
      return "slow runs in both directions, with and without load";
    case Run::kConstantSpeeds:
      return "constant speeds from standstill to rated speed in both directions";
    default:
      return "a run that varies speed, load and i_d independently";
  }
}

// The first of the runs that the traits of the kinds and, for pairs, of their relatives name.
Run run_that_separates(const std::vector<std::string>& kinds) {
  Run first = Run::kVaried;
  const auto may = [&](Run run) {
    const bool of_two_alone = run == Run::kUncoupled || run == Run::kWindingAlone;
    if (!of_two_alone || kinds.size() == 2) first = std::min(first, run);
  };
  for (const std::string& kind : kinds) {
    const Traits traits = make_effect(kind)->tracing().traits();
    may(traits.told_by);
    for (const Traits::Relative& relative : traits.relatives)
      if (std::count(kinds.begin(), kinds.end(), relative.kind)) may(relative.run);
  }
  return first;
}

bool is_beyond_a_run(Run run) {
  return run <= Run::kWindingAlone;
}

}  // namespace

std::string beyond_a_run(const std::vector<std::string>& kinds) {
  const Run run = run_that_separates(kinds);
  return is_beyond_a_run(run) ? text_of(run) : "";
}

std::string what_separates(const std::vector<std::string>& kinds) {
  const Run run = run_that_separates(kinds);
  const char* proposal = is_beyond_a_run(run) ? "" : " (twinrate trace --plan proposes one)";
  return std::string(text_of(run)) + proposal;
}

}  // namespace twinrate
