// Currents that stand for a row while the rest of it goes on: a converter that was not read.
//
// A coarse current repeats by chance, too, but then as if time ran backwards: of two equal rows
// k-1, k of a current that changes by v a row, chance leaves one as far behind the line through the
// rows around as the other before it, so e = i_{k-1} + i_k less twice the line between them is 0 in
// the mean. Where k is held, i_{k-1} is right and e = -v. The share of held rows is therefore
//   -sum(e v) over the rows that repeat / sum(v^2) over all rows
// and its sigma comes from the scatter of e v.
#pragma once
#include <cstddef>
#include <vector>

#include "model/frames.hpp"
#include "trace/health.hpp"

namespace twinrate {

// Rows k-1 and k of the currents (i_a and i_b, or i_alpha and i_beta) by the three on either side.
struct CurrentPair {
  bool repeats = false;       // both currents
  Vec2 way = Vec2::Zero();    // A a row, of the line
  Vec2 ahead = Vec2::Zero();  // A, of the two together before the line
  // Nearer to what a held row leaves than to what chance does.
  bool looks_held() const { return repeats && -2 * ahead.dot(way) > way.squaredNorm(); }
};
// Nothing repeats where rows are missing around k, or there are no such currents.
CurrentPair current_pair(const RawLog& raw, std::size_t k, double T_s);

class HeldCurrents {
 public:
  void add(const CurrentPair& pair);
  double share() const;  // of all rows; 0 where the repeated ones may all be chance

 private:
  double behind_ = 0, scatter_ = 0, squares_ = 0;
};

}  // namespace twinrate
