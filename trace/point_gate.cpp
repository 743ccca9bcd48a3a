#include "trace/point_gate.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace twinrate {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

class Asking {
 public:
  Asking(const PointRows& rows, const std::vector<PointClaim>& claims, const Criterion& criterion)
      : rows_(rows),
        claims_(claims),
        criterion_(criterion),
        seen_(sums([&](std::size_t k) { return !rows.judges[k]; })) {
    all_ = fitted({});
    with_ = rest(all_);
    std::vector<Index> every;
    for (const PointClaim& claim : claims)
      every.insert(every.end(), claim.columns.begin(), claim.columns.end());
    none_ = rest(fitted(every));
    for (const PointClaim& claim : claims) {
      without_.push_back(rest(fitted(claim.columns)));
      votes_.push_back(vote(without_.back()));
    }
  }
  PointAnswer answer() const;

 private:
  template <class In>
  PartSums sums(In in) const {
    std::vector<Index> some;
    for (std::size_t k = 0; k < rows_.size(); ++k)
      if (in(k)) some.push_back(static_cast<Index>(k));
    return {rows_.x(some, Eigen::all), rows_.y(some)};
  }
  // Coefficients from the rows that do not judge, those of `out` at zero.
  VectorXd fitted(const std::vector<Index>& out) const {
    std::vector<char> held(static_cast<std::size_t>(rows_.x.cols()), 0);
    for (Index c : out) held[static_cast<std::size_t>(c)] = 1;
    return best_answer(seen_, held, VectorXd::Zero(rows_.x.cols())).beta;
  }
  VectorXd rest(const VectorXd& beta) const { return rows_.y - rows_.x * beta; }
  // Energy of the rows that judge in one channel.
  double energy(const VectorXd& rest, int channel) const {
    double sum = 0;
    for (std::size_t k = 0; k < rows_.size(); ++k)
      if (rows_.judges[k] && rows_.channel[k] == channel)
        sum += rest[static_cast<Index>(k)] * rest[static_cast<Index>(k)];
    return sum;
  }
  bool moves(const VectorXd& without, int channel) const {
    return energy(with_ - without, channel) > criterion_.silent * energy(without, channel);
  }
  Votes vote(const VectorXd& without) const;
  double gain_where_seen(std::size_t m) const;
  Refused of_sensors(std::size_t m) const;
  Refused of_agreement(std::size_t m) const;
  Refused of_size(std::size_t m) const;
  Refused of_rest(std::size_t m) const;
  Refused of_whole(std::size_t& weakest) const;

  const PointRows& rows_;
  const std::vector<PointClaim>& claims_;
  const Criterion& criterion_;
  PartSums seen_;
  VectorXd all_, with_, none_;
  std::vector<VectorXd> without_;
  std::vector<Votes> votes_;
};

Votes Asking::vote(const VectorXd& without) const {
  Pieces before, after;
  const int channels = static_cast<int>(rows_.channels.size());
  for (int channel = 0; channel < channels; ++channel) {
    if (!moves(without, channel)) continue;
    for (std::size_t k = 0; k < rows_.size(); ++k) {
      if (!rows_.judges[k] || rows_.channel[k] != channel) continue;
      const auto row = static_cast<Index>(k);
      before[{rows_.file[k], rows_.piece[k]}] += without[row] * without[row];
      after[{rows_.file[k], rows_.piece[k]}] += with_[row] * with_[row];
    }
  }
  return votes_of(before, after, criterion_.silent);
}

// A claim smaller than one count of the readings on which it acts may be their rounding.
Refused Asking::of_sensors(std::size_t m) const {
  if (rows_.lsb.empty()) return {};
  VectorXd share = VectorXd::Zero(rows_.y.size());
  for (Index c : claims_[m].columns) share += rows_.x.col(c) * all_[c];
  double counts = 0;
  for (int channel = 0; channel < static_cast<int>(rows_.channels.size()); ++channel) {
    const double lsb = rows_.lsb[static_cast<std::size_t>(channel)];
    const double n = energy(VectorXd::Ones(rows_.y.size()), channel);
    const double rms = std::sqrt(energy(share, channel) / std::max(1.0, n));
    counts = std::max(counts, lsb > 0 ? rms / lsb : rms > 0 ? 1 : 0);
  }
  if (counts >= 1) return {};
  return {.rule = "sensors",
          .number = counts,
          .text = fmt::format("{:.2g} times one count of the readings", counts)};
}

Refused Asking::of_agreement(std::size_t m) const {
  std::vector<char> own(static_cast<std::size_t>(rows_.x.cols()), 0);
  for (Index c : claims_[m].columns) own[static_cast<std::size_t>(c)] = 1;
  const double least =
      criterion_.sigmas * criterion_.sigmas + static_cast<double>(claims_[m].columns.size());
  Agreement a;
  for (const PartsOfRows& pair : rows_.parts) {
    const PartSums one = sums([&](std::size_t k) { return pair.part[k] == 0; }),
                   other = sums([&](std::size_t k) { return pair.part[k] == 1; });
    compare_parts(one, other, own, least, pair.between, a);
    compare_parts(other, one, own, least, pair.between, a);
  }
  if (a.kept < criterion_.kept)
    return {.rule = "agreement",
            .number = a.kept,
            .text = fmt::format("{:.2g} of its gain is kept between {}", a.kept, a.between)};
  if (a.compared < 2)
    return {.rule = "agreement",
            .number = static_cast<double>(a.compared),
            .text = "no two parts of the data show it"};
  return {};
}

// Share of the error that the claim removes on the rows that do not judge.
double Asking::gain_where_seen(std::size_t m) const {
  double with = 0, without = 0;
  for (std::size_t k = 0; k < rows_.size(); ++k) {
    if (rows_.judges[k]) continue;
    with += std::pow(with_[static_cast<Index>(k)], 2);
    without += std::pow(without_[m][static_cast<Index>(k)], 2);
  }
  return without > 0 ? 1 - with / without : 0;
}

Refused Asking::of_size(std::size_t m) const {
  const double gain = gain_where_seen(m);
  const double sigmas = std::sqrt(std::max(0.0, gain / std::max(1 - gain, 1e-300) * seen_.count));
  if (sigmas >= criterion_.size_sigmas) return {};
  return {.rule = "size",
          .number = sigmas,
          .text = fmt::format("{:.2g} standard deviations from zero", sigmas)};
}

Refused Asking::of_rest(std::size_t m) const {
  double left = 0, taken = 0;
  for (int channel = 0; channel < static_cast<int>(rows_.channels.size()); ++channel) {
    if (!moves(without_[m], channel)) continue;
    const double n = energy(VectorXd::Ones(rows_.y.size()), channel);
    left += n * shared_by_neighbours(with_, rows_, channel, criterion_).power;
    taken += energy(none_, channel) - energy(with_, channel);
  }
  const double times = left > 0 ? taken / left : criterion_.times_left;
  if (times >= criterion_.times_left) return {};
  return {.rule = "whole",
          .number = times,
          .text = fmt::format("all effects together remove only {:.2g} times the energy that no "
                              "effect explains in the same signals",
                              times)};
}

Refused Asking::of_whole(std::size_t& weakest) const {
  for (int channel = 0; channel < static_cast<int>(rows_.channels.size()); ++channel) {
    std::vector<double> before(rows_.files.size(), 0), after(before);
    for (std::size_t k = 0; k < rows_.size(); ++k) {
      if (!rows_.judges[k] || rows_.channel[k] != channel) continue;
      const auto row = static_cast<Index>(k);
      before[static_cast<std::size_t>(rows_.file[k])] += none_[row] * none_[row];
      after[static_cast<std::size_t>(rows_.file[k])] += with_[row] * with_[row];
    }
    for (std::size_t f = 0; f < before.size(); ++f) {
      if (after[f] <= before[f] * (1 + criterion_.silent)) continue;
      for (std::size_t m = 0; m < claims_.size(); ++m)
        if (moves(without_[m], channel) && votes_[m].mean <= votes_[weakest].mean) weakest = m;
      return {.rule = "whole",
              .file = rows_.files[f],
              .number = after[f] / before[f] - 1,
              .text = fmt::format("all effects together raise the error of {}",
                                  rows_.channels[static_cast<std::size_t>(channel)])};
    }
  }
  return {};
}

PointAnswer Asking::answer() const {
  PointAnswer out{.beta = all_, .judgements = {}, .refused = {}};
  for (std::size_t m = 0; m < claims_.size(); ++m) {
    out.judgements.push_back(votes_[m].judgement);
    out.judgements.back().fitted_gain = gain_where_seen(m);
  }
  const std::vector<Refused> transfer = refused_by_transfer(votes_, rows_.files, criterion_);
  const auto take = [&](std::size_t m, const Refused& why) {
    if (why.rule.empty() || (out.refused && votes_[m].mean >= votes_[out.weakest].mean)) return;
    out.refused = why;
    out.weakest = m;
  };
  for (std::size_t m = 0; m < claims_.size(); ++m) {
    Refused why;
    if (claims_[m].size < 1)
      why = {
          .rule = "size",
          .number = claims_[m].size,
          .text = fmt::format("{:.2g} times the smallest size worth reporting", claims_[m].size)};
    if (why.rule.empty()) why = of_sensors(m);
    if (why.rule.empty()) why = transfer[m];
    if (why.rule.empty()) why = of_agreement(m);
    if (why.rule.empty()) why = of_size(m);
    if (why.rule.empty()) why = of_rest(m);
    take(m, why);
  }
  if (!out.refused && !claims_.empty()) {
    std::size_t weakest = 0;
    if (const Refused why = of_whole(weakest); !why.rule.empty())
      out.refused = why, out.weakest = weakest;
  }
  if (!out.refused) return out;
  Refused& why = *out.refused;
  why.kind = claims_[out.weakest].kind;
  why.left = why.rule != "size" && why.rule != "sensors" &&
             votes_[out.weakest].judgement.p_value < criterion_.chance;
  return out;
}

}  // namespace

PointAnswer ask(const PointRows& rows, const std::vector<PointClaim>& claims,
                const Criterion& criterion) {
  return Asking(rows, claims, criterion).answer();
}

Shared shared_by_neighbours(const VectorXd& rest, const PointRows& rows, int channel,
                            const Criterion& criterion) {
  double product = 0, square = 0, pairs = 0, count = 0;
  for (std::size_t k = 0; k < rows.size(); ++k) {
    if (rows.channel[k] != channel) continue;
    const double own = rest[static_cast<Index>(k)];
    square += own * own;
    ++count;
    if (rows.next[k] < 0) continue;
    product += own * rest[rows.next[k]];
    ++pairs;
  }
  if (pairs < 2 || square == 0) return {};
  const double share = product / pairs / (square / count);
  if (share * std::sqrt(pairs) < criterion.sigmas) return {};
  return {share * square / count, share};
}

}  // namespace twinrate
