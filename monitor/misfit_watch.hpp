// Does the model still fit? Blocks of drive data against what they were like while it did.
//
//   channels   residual of the voltage equation (d, q) and of the torque equation, at 1 kHz
//              (trace/equations.hpp), and the innovations of the running filter, at f_s
//   learning   an autoregressive model of each channel's noise (trace/whitening.hpp) from the first
//              blocks, and the largest mean square that a whitened block of them had
//   judging    e whitened by that model. Consistency: N mean(e^2) is chi-square with N degrees of
//              freedom. Whiteness: Ljung-Box over 20 lags.
//
// A block fails where a channel is less consistent than 1e-9 allows and its mean square is beyond
// kMargin times the largest learnt (speed and load may move while it learns, and then the learnt
// blocks are not equal either). A model that fits badly from the start is the level itself.
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
  double excess = 1;       // mean square of the whitened, over the largest learnt
  double consistency = 1;  // p-value
  double whiteness = 1;    // p-value
};

struct BlockJudgement {
  bool fits = true;
  std::vector<ChannelLevel> channels;
  const ChannelLevel* worst() const;
  std::string text() const;  // one line: the worst channel
};

class MisfitWatch {
 public:
  explicit MisfitWatch(const DriveConfig& drive);
  static constexpr double kMargin = 2;

  void learn(const std::deque<MeasuredRow>& rows, std::size_t first, std::size_t last,
             const std::vector<Estimate>& estimates, const Effects& known);
  // Ends learning. False where there was nothing to learn from.
  bool learnt();
  // A block of an extended model: a channel that is a little noisier than learnt (an effect
  // computed from noisy currents is noisy itself) is normal from now on; one with a mean square
  // more than kRestless times as large is not.
  static constexpr double kRestless = 9;
  void accept(const std::deque<MeasuredRow>& rows, std::size_t first, std::size_t last,
              const std::vector<Estimate>& estimates, const Effects& known);
  BlockJudgement judge(const std::deque<MeasuredRow>& rows, std::size_t first, std::size_t last,
                       const std::vector<Estimate>& estimates, const Effects& known) const;

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
                                          const Effects& known) const;

  DriveConfig drive_;
  std::map<std::string, Level> levels_;
};

// Rms of the residuals (d, q in V, torque in Nm) of rows [first, last) under a model, at 1 kHz.
struct ResidualRms {
  double voltage = 0, torque = 0;
};
ResidualRms residual_rms(const DriveConfig& drive, const std::deque<MeasuredRow>& rows,
                         std::size_t first, std::size_t last, const Effects& known);

}  // namespace twinrate
