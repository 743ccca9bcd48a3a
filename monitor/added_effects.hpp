// Judges the effects that were added to the running model, on the rows after each addition.
//
//   r_b = 1/2 ln(E_b without / E_b with)     of a piece b, kPiecesOfBlock to a block
//
// E: energy of the whitened residuals (monitor/misfit_watch.hpp) in the channels that the effect
// moves, no noise subtracted; `with` and `without` are of the same rows, with all other effects in
// the model. Pieces whose energy changes by less than Criterion::silent do not vote. An effect is
// worse if, by Wilcoxon's signed-rank test over its last kVotes votes, the error is larger with it
// beyond chance (Criterion::chance).
#pragma once
#include <deque>
#include <optional>
#include <vector>

#include "monitor/misfit_watch.hpp"

namespace twinrate {

struct AddedEffect {
  ConfiguredEffect effect;
  std::optional<std::size_t> episode;  // the addition; none after a restart
  std::int64_t from_k = 0;             // first row of its judgement
  std::deque<double> votes;            // r_b, the latest last
};

// Evidence that an added effect is worse than none.
struct Worse {
  std::size_t place = 0;  // index among the added effects
  int votes = 0;
  double p_value = 1;  // of the signed-rank test
  double rise = 0;     // of the rms error with it, as a share: exp(-median r) - 1
};

class AddedEffects {
 public:
  static constexpr std::size_t kPiecesOfBlock = 5, kVotes = 40;

  bool empty() const { return list_.empty(); }
  std::size_t size() const { return list_.size(); }
  const AddedEffect& operator[](std::size_t place) const { return list_[place]; }
  void add(const std::vector<ConfiguredEffect>& effects, std::size_t episode, std::int64_t from_k);
  void remove(std::size_t place);
  // Begins another run: the added effects stay, without their votes.
  void restart();
  // Votes of the rows [first, last); `drive` ends with the added effects.
  void judge(const MisfitWatch& watch, const DriveConfig& drive,
             const std::deque<MeasuredRow>& rows, std::size_t first, std::size_t last);
  std::optional<Worse> worst() const;

 private:
  std::vector<AddedEffect> list_;
};

// The model of `drive` without one of the effects that were added last.
Effects model_without(const DriveConfig& drive, std::size_t added, std::size_t place);

}  // namespace twinrate
