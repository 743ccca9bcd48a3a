#include "trace/contest.hpp"

#include <algorithm>
#include <cmath>

#include "core/config.hpp"
#include "trace/gate.hpp"
#include "trace/statistics.hpp"
#include "trace/thinning.hpp"
#include "trace/whitening.hpp"

namespace twinrate {
namespace {

constexpr double kLikely = 55;       // of the sum of squares, not whitened: a likelihood ratio of
                                     // 0.001 for noise whose four neighbours are alike
constexpr std::size_t kPieces = 96;  // of a side, each with one vote

}  // namespace

Contest::Contest(const Record& whole, const DriveConfig& drive, const Effects& before,
                 const Effects& behind, std::size_t border)
    : rows_(rows_as_one(whole.T_s)),
      record_(thinned(whole, rows_, drive.machine.n_p)),
      equations_(record_, drive.facts(), drive.model_effects()),
      sampler_(record_, moving_rows(record_), std::vector<char>(record_.size(), 0)) {
  const Channels e_1 = equations_.residual(before), e_2 = equations_.residual(behind);
  const auto row_of = [&](const Runs& runs, Eigen::Index i) {
    return runs.row[static_cast<std::size_t>(i)] * whole.size() / record_.size();
  };
  const auto add = [&](auto member, const Runs& runs) {
    if ((e_1.*member).empty()) return;
    const Eigen::VectorXd y_1 = sampler_(e_1.*member, runs), y_2 = sampler_(e_2.*member, runs);
    if (!y_1.size() || (y_2 - y_1).squaredNorm() <= Criterion{}.silent * y_1.squaredNorm()) return;
    Eigen::VectorXd left = y_1;  // residual of the set that holds at each row: the noise
    for (Eigen::Index i = 0; i < left.size(); ++i)
      if (row_of(runs, i) >= border) left[i] = y_2[i];
    const double noise = left.squaredNorm() / static_cast<double>(left.size());
    const Whitener white(left, runs);
    const Eigen::VectorXd w_1 = white(y_1, runs), w_2 = white(y_2, runs);
    for (Eigen::Index i = 0; i < w_1.size(); ++i)
      terms_.push_back({.row = row_of(runs, i),
                        .e_1 = w_1[i] * w_1[i],
                        .e_2 = w_2[i] * w_2[i],
                        .fall = (y_1[i] * y_1[i] - y_2[i] * y_2[i]) / noise});
  };
  add(&Channels::d, sampler_.electrical());
  add(&Channels::q, sampler_.electrical());
  add(&Channels::torque, sampler_.torque());
  std::sort(terms_.begin(), terms_.end(),
            [](const Term& a, const Term& b) { return a.row < b.row; });
}

Contest::Side Contest::better(bool second, std::size_t first, std::size_t end,
                              const std::vector<char>& judging) const {
  std::vector<double> one(kPieces, 0), two(kPieces, 0), votes;
  for (const Term& term : terms_) {
    if (term.row < first || term.row >= end || !judging[term.row]) continue;
    const std::size_t b = kPieces * (term.row - first) / (end - first);
    one[b] += second ? term.e_1 : term.e_2;
    two[b] += second ? term.e_2 : term.e_1;
  }
  double sum_1 = 0, sum_2 = 0;
  for (std::size_t b = 0; b < kPieces; ++b) {
    sum_1 += one[b], sum_2 += two[b];
    if (one[b] > 0 && two[b] > 0 && std::abs(one[b] - two[b]) > Criterion{}.silent * one[b])
      votes.push_back(0.5 * std::log(one[b] / two[b]));
  }
  if (!(sum_2 < sum_1)) return {};
  return {signed_rank_tail(votes), 1 - sum_2 / sum_1};
}

std::array<std::size_t, 3> Contest::moment(std::size_t first, std::size_t end) const {
  double sum = 0, least = 0;
  std::size_t best = first;
  std::vector<std::pair<std::size_t, double>> sums;  // of e_1^2 - e_2^2 up to a row
  for (const Term& term : terms_) {
    if (term.row < first || term.row >= end) continue;
    sum += term.fall;
    sums.emplace_back(term.row, sum);
    if (sum < least) least = sum, best = term.row;
  }
  std::size_t from = best, to = best;
  for (const auto& [row, value] : sums)
    if (value < least + kLikely) from = std::min(from, row), to = std::max(to, row);
  const auto reach = static_cast<std::size_t>(kReach_s / record_.T_s) * rows_;  // of the low-pass
  return {from - std::min(from - first, reach), best, std::min(end - 1, to + reach)};
}

}  // namespace twinrate
