#include "monitor/added_effects.hpp"

#include <algorithm>
#include <cmath>

#include "model/math.hpp"
#include "trace/gate.hpp"
#include "trace/statistics.hpp"

namespace twinrate {
namespace {

using Residuals = std::vector<Eigen::VectorXd>;  // whitened, by channel

// Votes of the pieces of one block.
std::vector<double> votes_of(const Residuals& with, const Residuals& without, double silent) {
  constexpr std::size_t n = AddedEffects::kPiecesOfBlock;
  std::vector<double> E_with(n, 0), E_without(n, 0), votes;
  for (std::size_t c = 0; c < with.size() && c < without.size(); ++c) {
    if (with[c].size() != without[c].size()) continue;
    if ((with[c] - without[c]).squaredNorm() <= silent * without[c].squaredNorm()) continue;
    const auto rows = static_cast<std::size_t>(with[c].size());
    for (std::size_t i = 0; i < rows; ++i) {
      const auto k = static_cast<Eigen::Index>(i);
      E_with[n * i / rows] += with[c][k] * with[c][k];
      E_without[n * i / rows] += without[c][k] * without[c][k];
    }
  }
  for (std::size_t b = 0; b < n; ++b)
    if (E_with[b] > 0 && E_without[b] > 0 &&
        std::abs(E_with[b] - E_without[b]) > silent * E_without[b])
      votes.push_back(0.5 * math::log(E_without[b] / E_with[b]));
  return votes;
}

double median(std::vector<double> x) {
  const auto middle = x.begin() + static_cast<std::ptrdiff_t>(x.size() / 2);
  std::nth_element(x.begin(), middle, x.end());
  return *middle;
}

}  // namespace

Effects model_without(const DriveConfig& drive, std::size_t added, std::size_t place) {
  DriveConfig without = drive;
  without.effects.erase(without.effects.end() - static_cast<std::ptrdiff_t>(added - place));
  return without.model_effects();
}

void AddedEffects::add(const std::vector<ConfiguredEffect>& effects, std::size_t episode,
                       std::int64_t from_k) {
  for (const ConfiguredEffect& effect : effects) list_.push_back({effect, episode, from_k, {}});
}

void AddedEffects::remove(std::size_t place) {
  list_.erase(list_.begin() + static_cast<std::ptrdiff_t>(place));
  for (AddedEffect& a : list_) a.votes.clear();  // their comparisons included the removed effect
}

void AddedEffects::restart() {
  for (AddedEffect& a : list_) {
    a.episode.reset();
    a.from_k = 0;
    a.votes.clear();
  }
}

void AddedEffects::judge(const MisfitWatch& watch, const DriveConfig& drive,
                         const std::deque<MeasuredRow>& rows, std::size_t first, std::size_t last) {
  if (list_.empty() || first >= last) return;
  const Residuals with = watch.whitened(rows, first, last, drive.model_effects());
  for (std::size_t place = 0; place < list_.size(); ++place) {
    AddedEffect& a = list_[place];
    if (rows[first].m.k < a.from_k) continue;
    const Residuals without =
        watch.whitened(rows, first, last, model_without(drive, list_.size(), place));
    for (const double r : votes_of(with, without, Criterion{}.silent)) a.votes.push_back(r);
    while (a.votes.size() > kVotes) a.votes.pop_front();
  }
}

std::optional<Worse> AddedEffects::worst() const {
  const Criterion criterion;
  std::optional<Worse> worst;
  for (std::size_t place = 0; place < list_.size(); ++place) {
    std::vector<double> against;
    for (const double r : list_[place].votes) against.push_back(-r);
    if (static_cast<int>(against.size()) < criterion.votes) continue;
    const double p = signed_rank_tail(against);
    if (p < criterion.chance && (!worst || p < worst->p_value))
      worst = Worse{.place = place,
                    .votes = static_cast<int>(against.size()),
                    .p_value = p,
                    .rise = math::exp(median(std::move(against))) - 1};
  }
  return worst;
}

}  // namespace twinrate
