#include "trace/split.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numeric>

namespace twinrate {
namespace {

constexpr int kBlocks = 24;
constexpr double kChoosing = 4.0 / 18;  // of the blocks that do not judge
// Weight of all accelerations, and of all currents, in the blocks; that of the time of all rows is
// 1.
constexpr double kActivity = 0.25;
// The shortest block is an even one over kShortest, and has at least kFewestRows rows if an even
// one has: the low-pass and the whitening lose some fifty rows at each end. With 208 rows (two
// seconds of 10 kHz) three tests of trace lost the missing effect.
constexpr double kShortest = 4, kFewestRows = 250;
// A share is fair to this factor. Its logarithm, 0.69, lies between drawn logs of one start (0.76
// to 4.1, or below 0.54 if even blocks suffice) and those of other profiles (at most 0.58).
constexpr double kFair = 2;
constexpr std::size_t kNone = std::numeric_limits<std::size_t>::max();

// Squares of the drive's activity in each row: of its acceleration and of its currents.
struct Squares {
  static constexpr std::size_t kReach = 20;  // rows that an acceleration needs on each side
  std::vector<double> motion, current, i_d;
  Squares(const Record& record, int n_p)
      : motion(record.size(), 0), current(record.size(), 0), i_d(record.size(), 0) {
    for (std::size_t k = kReach; k + kReach < record.size(); ++k) {
      const double bend =
          record.theta_m[k + kReach] - 2 * record.theta_m[k] + record.theta_m[k - kReach];
      // Not across a seam.
      if (record.motion_ok[k - kReach] && record.motion_ok[k] && record.motion_ok[k + kReach])
        motion[k] = bend * bend;
      if (!record.electrical_ok[k] || record.i_alphabeta.empty()) continue;
      const double along_d = park(record.i_alphabeta[k], n_p * record.theta_m[k])[0];
      current[k] = record.i_alphabeta[k].squaredNorm();
      i_d[k] = along_d * along_d;
    }
  }
};

// Sums of these squares by set of rows.
struct Activity {
  std::vector<double> motion, current, i_d, rows;
  explicit Activity(std::size_t sets)
      : motion(sets, 1e-12), current(motion), i_d(motion), rows(sets, 1e-12) {}

  static double uneven_share(const std::vector<double>& x, const std::vector<double>& rows,
                             std::size_t set) {
    const double all = std::accumulate(x.begin(), x.end(), 0.0),
                 all_rows = std::accumulate(rows.begin(), rows.end(), 0.0);
    return std::log(x[set] / all * all_rows / rows[set]);
  }
  // A set needs only a little i_d; but a set with all of it would leave none to the fit.
  double uneven(std::size_t set) const {
    return std::abs(uneven_share(motion, rows, set)) + std::abs(uneven_share(current, rows, set)) +
           std::max(0.0, uneven_share(i_d, rows, set));
  }
};

using SetOf = std::function<std::size_t(std::size_t row)>;  // kNone: of no set

// The set with the most even part of the drive's activity.
std::size_t most_even(const Squares& squares, std::size_t sets, const SetOf& set_of,
                      double* uneven = nullptr) {
  Activity sum(sets + 1);  // the last one: of no set
  for (std::size_t k = Squares::kReach; k + Squares::kReach < squares.motion.size(); ++k) {
    const std::size_t set = std::min(set_of(k), sets);
    ++sum.rows[set];
    sum.motion[set] += squares.motion[k];
    sum.current[set] += squares.current[k];
    sum.i_d[set] += squares.i_d[k];
  }
  std::size_t best = 0;
  for (std::size_t set = 1; set < sets; ++set)
    if (sum.uneven(set) < sum.uneven(best)) best = set;
  if (uneven) *uneven = sum.uneven(best);
  return best;
}

// Block of each row that is not left out, in order of time; kNone: of no block.
std::vector<std::size_t> even_blocks(std::size_t rows, const std::vector<char>& left_out,
                                     int blocks) {
  const auto asked = [&](std::size_t k) { return left_out.empty() || !left_out[k]; };
  std::size_t count = 0, rank = 0;
  for (std::size_t k = 0; k < rows; ++k) count += asked(k);
  std::vector<std::size_t> block(rows, kNone);
  for (std::size_t k = 0; k < rows; ++k)
    if (asked(k)) block[k] = static_cast<std::size_t>(blocks) * rank++ / count;
  return block;
}

// The same, with equal sums of the rows' weights.
std::vector<std::size_t> active_blocks(const Squares& squares, const std::vector<char>& left_out,
                                       int blocks) {
  const std::size_t n = squares.motion.size();
  const auto asked = [&](std::size_t k) { return left_out.empty() || !left_out[k]; };
  double rows = 0, motion = 1e-300, current = 1e-300;
  for (std::size_t k = 0; k < n; ++k)
    if (asked(k)) ++rows, motion += squares.motion[k], current += squares.current[k];
  const double most = std::clamp(rows / (kFewestRows * blocks), 1.0, kShortest) / rows;
  std::vector<double> upto(n);
  double whole = 0;
  for (std::size_t k = 0; k < n; ++k) {
    if (asked(k))
      whole += std::min(
          most, 1 / rows + kActivity * (squares.motion[k] / motion + squares.current[k] / current));
    upto[k] = whole;
  }
  std::vector<std::size_t> block(n, kNone);
  const auto last = static_cast<std::size_t>(blocks - 1);
  for (std::size_t k = 0; k < n; ++k)
    if (asked(k))
      block[k] = std::min(last, static_cast<std::size_t>(blocks * upto[k] / whole * (1 - 1e-12)));
  return block;
}

// True if a fourth of even blocks has its share of the drive's activity, to a factor of kFair.
bool does_the_same_throughout(const Squares& squares) {
  constexpr std::size_t kSets = 4;
  const std::vector<std::size_t> block = even_blocks(squares.motion.size(), {}, kBlocks);
  double uneven = 0;
  most_even(
      squares, kSets, [&](std::size_t k) { return block[k] % kSets; }, &uneven);
  return uneven < std::log(kFair);
}

std::vector<std::size_t> blocks_of(const Squares& squares, const std::vector<char>& left_out,
                                   int blocks) {
  return does_the_same_throughout(squares) ? even_blocks(squares.motion.size(), left_out, blocks)
                                           : active_blocks(squares, left_out, blocks);
}

// Number of blocks for the rows that do not judge: the blocks of the record that remain if blocks
// judge; if whole files judge, as many as a record has.
int blocks_left(const std::vector<char>& judging, std::size_t left) {
  constexpr int kFewStretches = 2;
  int stretches = 0;
  for (std::size_t k = 0; k < judging.size(); ++k)
    stretches += judging[k] && (k == 0 || !judging[k - 1]);
  if (stretches <= kFewStretches) return kBlocks;
  const auto judged = static_cast<double>(judging.size() - left);
  return std::max(2, static_cast<int>(std::lround(stretches * static_cast<double>(left) / judged)));
}

}  // namespace

std::vector<std::size_t> blocks_of_rows(const Record& record, int n_p) {
  return blocks_of(Squares(record, n_p), {}, kBlocks);
}

std::vector<char> held_out_rows(const Record& record, double share, int n_p) {
  std::vector<char> held(record.size(), 0);
  if (share <= 0) return held;
  const auto every = static_cast<std::size_t>(std::max(2L, std::lround(1 / share)));
  const Squares squares(record, n_p);
  const std::vector<std::size_t> block = blocks_of(squares, {}, kBlocks);
  const auto set_of = [&](std::size_t k) { return block[k] % every; };
  const std::size_t best = most_even(squares, every, set_of);
  for (std::size_t k = 0; k < held.size(); ++k) held[k] = set_of(k) == best;
  return held;
}

std::vector<char> choosing_rows(const Record& record, const std::vector<char>& judging, int n_p) {
  const auto left = static_cast<std::size_t>(std::count(judging.begin(), judging.end(), char{0}));
  std::vector<char> chosen(record.size(), 0);
  if (left == 0) return chosen;
  const int blocks = blocks_left(judging, left);
  // Set c: blocks c + 1, c + 5.5, c + 10 .. The first one, in which a drive may start, always fits.
  const auto sets = static_cast<std::size_t>(std::floor(1 / kChoosing)) - 1;
  std::vector<std::size_t> set_of_block(static_cast<std::size_t>(blocks), kNone);
  for (std::size_t set = 0; set < sets; ++set)
    for (double at = static_cast<double>(set + 1); std::lround(at) < blocks; at += 1 / kChoosing)
      if (std::size_t& own = set_of_block[static_cast<std::size_t>(std::lround(at))]; own == kNone)
        own = set;
  const Squares squares(record, n_p);
  const std::vector<std::size_t> block = blocks_of(squares, judging, blocks);
  const auto set_of = [&](std::size_t k) {
    return block[k] == kNone ? kNone : set_of_block[block[k]];
  };
  const std::size_t best = most_even(squares, sets, set_of);
  for (std::size_t k = 0; k < chosen.size(); ++k) chosen[k] = set_of(k) == best;
  return chosen;
}

void hide(const std::vector<char>& rows, Record& record) {
  for (std::size_t k = 0; k < rows.size(); ++k)
    if (rows[k]) record.electrical_ok[k] = record.motion_ok[k] = 0;
}

}  // namespace twinrate
