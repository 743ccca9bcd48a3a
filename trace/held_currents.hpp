// Currents that stand for a row while the rest of it goes on: a converter that was not read.
//
// A coarse current repeats by chance, too, but then as if time ran backwards: of two equal rows
// k-1, k of a current that changes by v a row, chance leaves one as far behind the line through the
// rows around as the other before it, so e = i_{k-1} + i_k less twice the line between them is 0 in
// the mean. Where k is held, i_{k-1} is right and e = -v. The share of held rows is therefore
//   -sum(e v) over the rows that repeat / sum(v^2) over all rows
// and its sigma comes from the scatter of e v. A third sensor has to repeat with them.
//
// Time does run one way where a current leaps and decays, as at each count of a coarse encoder: a
// row that repeats before the leap lies behind by chance. One current that repeats alone does so,
// too; what is held repeats all. What each does alone is therefore taken off, and where that is
// beyond its own sigma nothing is concluded from the side on which they lie.
//
// Where currents change by less than their step a row, v is lost in noise. There both repeat by
// chance as often as each does by itself: of n rows n_x n_y/n (n_x n_y n_z/n^2 of three sensors),
// more by 1/sqrt(1 - rho^2) where the noise of one is like that of the other, or by as many times
// as they repeat the row before the last together (bursts). What they do beyond that is held. (Noise that does not
// reach over the steps of the converter leaves both where they are, as long as neither is near an
// edge: nothing is said.)
#pragma once
#include <cstddef>
#include <vector>

#include "model/frames.hpp"
#include "trace/health.hpp"

namespace twinrate {

// Of the currents x, y and, where it is in the log, z; x and y are i_a and i_b, or i_alpha and
// i_beta.
struct Repeated {
  bool x = false, y = false, z = true;
  bool all() const { return x && y && z; }
};

// Rows k-1 and k of the currents (i_a and i_b, or i_alpha and i_beta) by the three on either side.
struct CurrentPair {
  bool known = false;           // there are such rows, none missing around them
  bool third = false;           // the three phases do not add up to 0: each has a sensor
  Repeated repeated, over_one;  // row k as row k-1, as row k-2
  Vec2 step = Vec2::Zero();     // A, from one to the other
  Vec2 way = Vec2::Zero();      // A a row, of the line
  Vec2 ahead = Vec2::Zero();    // A, of the two together before the line
  bool repeats() const { return repeated.all(); }
  // Nearer to what a held row leaves than to what chance does.
  bool looks_held() const { return repeats() && -2 * ahead.dot(way) > way.squaredNorm(); }
};
CurrentPair current_pair(const RawLog& raw, std::size_t k, double T_s);

class HeldCurrents {
 public:
  // `turning`: the angle goes on.
  void add(const CurrentPair& pair, bool turning);
  // Of all rows; 0 where the repeated ones may all be chance. `i_lsb`: step of the currents.
  double share(double i_lsb) const;

 private:
  // Rows that lie near one another, which all repeat equally often.
  struct Counts {
    int x = 0, y = 0, z = 0, all = 0;
    void add(const Repeated& repeated, bool third);
  };
  struct Few {
    int rows = 0;
    Counts next, over_one;
    std::size_t begin = 0;
  };
  // -e v of rows that repeat.
  struct Behind {
    double rows = 0, sum = 0, squares = 0;  // A^2, A^4
    void add(double behind) { ++rows, sum += behind, squares += behind * behind; }
  };
  void close_few();
  double behind_beyond_chance() const;
  double beyond_chance(double i_lsb) const;

  Behind together_, x_alone_, y_alone_;
  double squares_ = 0;  // A^2, of the way of all rows
  bool third_ = false;
  double least_step_ = 1e300;  // A, of one of the currents
  Few few_;
  double all_ = 0, by_chance_ = 0, variance_ = 0, others_ = 0;  // sums over them
  double all_over_one_ = 0, by_chance_over_one_ = 0;
  Eigen::Matrix2d steps_ = Eigen::Matrix2d::Zero();  // products of the steps' noise
  std::size_t seen_ = 0;
  double rows_ = 0;  // of these
};

}  // namespace twinrate
