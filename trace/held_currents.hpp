// Held currents: the currents repeat a row while the other signals change, because the converter
// was not read.
//
// A coarse current repeats by chance as well, but symmetrically in time. Let rows k-1, k be equal,
// and let the current change by v a row. By chance, one of the two rows is on average as far
// behind the line through the rows around as the other is ahead of it. So e = i_{k-1} + i_k less
// twice the line between them has the mean 0. If k is held, i_{k-1} is right and e = -v. The share
// of held rows is therefore
//   -sum(e v) over the rows that repeat / sum(v^2) over all rows,
// of the rows with v of more than one step,
// and its sigma comes from the scatter of e v. A third sensor must repeat with them.
//
// Time is not symmetric if a current leaps and decays, as at each count of a coarse encoder: a row
// that repeats before the leap lies behind by chance. Then one current that repeats alone lies
// behind as well, whereas a held row repeats all currents. So the part of each current that repeats
// alone is subtracted. If that part exceeds its own sigma, the side on which the rows lie is not
// used.
//
// If currents change by less than their step a row, v is lost in noise. Then both repeat by chance
// in n_x n_y/n of n rows, if each repeats in n_x and n_y rows (n_x n_y n_z/n^2 with three sensors).
// This number is multiplied by the larger of two factors. 1/sqrt(det R), R the correlations of the
// steps' noise, is the density of correlated steps at zero over that of independent ones: three
// currents that add up to nearly zero repeat together often. The other is the factor with which they
// repeat the row before the last together (bursts). Repetitions beyond it are held rows. All rows of
// a rotor that turns are counted: the rows at which a coarse angle changes lie before the leap of
// the current, and repeat more often than those around them. Currents that leap and ring are not
// noise: their mean squared change depends on the distance of the rows (kWhite), and no share is
// reported. (If the
// noise is smaller than the steps of the converter, both currents repeat as long as neither is near
// an edge. Then no share is reported. A current of less than two steps repeats while it is near
// zero: such rows do not count.)
#pragma once
#include <array>
#include <cstddef>
#include <vector>

#include "model/frames.hpp"
#include "trace/health.hpp"

namespace twinrate {

// Repetition of the currents x, y and, if it is in the log, z; x and y are i_a and i_b, or i_alpha
// and i_beta.
struct Repeated {
  bool x = false, y = false, z = true;
  bool all() const { return x && y && z; }
};

// Rows k-1 and k of the currents (i_a and i_b, or i_alpha and i_beta), against a line through three
// rows on either side.
struct CurrentPair {
  bool known = false;           // these rows exist, without a gap
  bool third = false;           // the three phases do not add up to 0: each has a sensor
  Repeated repeated, over_one;  // row k against row k-1, against row k-2
  Vec2 here = Vec2::Zero();     // A, row k
  Vec2 step = Vec2::Zero();     // A, from row k-1 to row k
  Vec2 way = Vec2::Zero();      // A a row, slope of the line
  Vec2 ahead = Vec2::Zero();    // A, sum of the two rows less twice the line (e above)
  // A^2, squared change from one to kDistances rows before to row k, less the line.
  static constexpr std::size_t kDistances = 4;
  std::array<double, kDistances> changes{};
  double noise_z = 0;  // A, step of the third current less the slope of its line
  bool repeats() const { return repeated.all(); }
  // Closer to the value of a held row than to that of chance.
  bool looks_held() const { return repeats() && -2 * ahead.dot(way) > way.squaredNorm(); }
};
CurrentPair current_pair(const RawLog& raw, std::size_t k, double T_s);

class HeldCurrents {
 public:
  // `angle_moves`: the angle differs from that of the row before.
  void add(const CurrentPair& pair, bool angle_moves);
  // Share of all rows; 0 if the repeated ones may all be chance. `i_lsb`: step of the currents.
  double share(double i_lsb) const;

 private:
  // Repetitions in a group of rows close to one another, in which each repeats equally often.
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
  double squares_ = 0;  // A^2, of the slope of all rows
  bool third_ = false;
  double least_step_ = 1e300;  // A, of one of the currents
  Few few_;
  double all_ = 0, by_chance_ = 0, variance_ = 0, others_ = 0;  // sums over the groups
  double all_over_one_ = 0, by_chance_over_one_ = 0;
  Eigen::Matrix3d steps_ = Eigen::Matrix3d::Zero();  // products of the steps' noise
  std::size_t seen_ = 0, moved_ = 0;  // rows; rows up to the last change of the angle
  std::array<double, CurrentPair::kDistances> changes_{};  // A^2, sums of those of the pairs
  double rows_ = 0;                                        // rows in these products
};

}  // namespace twinrate
