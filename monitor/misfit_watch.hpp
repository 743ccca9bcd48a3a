// Detects a misfit of the model: compares blocks of drive data with learnt blocks.
//
//   channels   residuals of the voltage equation (d, q) and of the torque equation, at 1 kHz
//              (trace/equations.hpp), and innovations of the running filter, at f_s
//   learning   from the first blocks: an autoregressive model of each channel's noise
//              (trace/whitening.hpp) and the largest mean square of a whitened block
//   testing    e: the block whitened by that model. Consistency: N mean(e^2) is chi-square with N
//              degrees of freedom. Whiteness: Ljung-Box over 20 lags.
//
// A block is a misfit if the consistency of a channel is below 1e-9 and its mean square exceeds
// kMargin times the largest learnt one (speed and load may vary during learning, so that the learnt
// blocks differ, too). A misfit that exists from the start is learnt as normal.
#pragma once
#include <map>
#include <string>
#include <vector>

#include "core/drive_config.hpp"
#include "trace/measured.hpp"
#include "trace/whitening.hpp"

namespace twinrate {

// One channel in one block.
struct ChannelLevel {
  std::string name, unit;
  double rms = 0;          // in `unit`
  double excess = 1;       // mean square of the whitened block over the largest learnt one
  double consistency = 1;  // p-value
  double whiteness = 1;    // p-value
  bool of_filter() const { return unit.empty(); }  // an innovation
};

struct BlockVerdict {
  bool fits = true;
  std::vector<ChannelLevel> channels;
  const ChannelLevel* worst() const;
  std::string text() const;  // the worst channel, one line
};

class MisfitWatch {
 public:
  explicit MisfitWatch(const DriveConfig& drive);
  static constexpr double kMargin = 2;

  void learn(const std::deque<MeasuredRow>& rows, std::size_t first, std::size_t last,
             const std::vector<Estimate>& estimates, const Effects& model_effects);
  // Ends learning. False if no channel has data.
  bool learnt();
  // A block with the extended model. Raises the learnt level of a channel that is noisier than
  // learnt: an effect computed from noisy currents adds noise. A mean square of more than
  // kMaxRise times the learnt one is not accepted.
  static constexpr double kMaxRise = 9;
  void accept(const std::deque<MeasuredRow>& rows, std::size_t first, std::size_t last,
              const std::vector<Estimate>& estimates, const Effects& model_effects);
  BlockVerdict test(const std::deque<MeasuredRow>& rows, std::size_t first, std::size_t last,
                    const std::vector<Estimate>& estimates, const Effects& model_effects) const;
  // The residuals of rows [first, last) under a model, each whitened as learnt. Channels that were
  // not learnt are left out.
  std::vector<Eigen::VectorXd> whitened(const std::deque<MeasuredRow>& rows, std::size_t first,
                                        std::size_t last, const Effects& model_effects) const;

 private:
  struct Series {
    Eigen::VectorXd y;
    Runs runs;
  };
  struct Level {
    Series all;
    std::vector<Series> blocks;
    Whitener whitener;
    double largest = 1;  // mean square of a whitened learnt block
  };
  std::map<std::string, Series> series_of(const std::deque<MeasuredRow>& rows, std::size_t first,
                                          std::size_t last, const std::vector<Estimate>& estimates,
                                          const Effects& model_effects) const;

  DriveConfig drive_;
  std::map<std::string, Level> levels_;
};

// Rms of the residuals (d, q in V, torque in Nm) of rows [first, last) under a model, at 1 kHz.
struct ResidualRms {
  double voltage = 0, torque = 0;
};
ResidualRms residual_rms(const DriveConfig& drive, const std::deque<MeasuredRow>& rows,
                         std::size_t first, std::size_t last, const Effects& model_effects);

}  // namespace twinrate
