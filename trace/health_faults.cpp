#include "trace/health_faults.hpp"

#include <algorithm>
#include <cmath>

#include "model/frames.hpp"
#include "trace/parallel.hpp"

namespace twinrate {
namespace {

constexpr std::size_t kAround = 3;   // rows on each side of a glitch
constexpr std::size_t kLongest = 3;  // rows of a glitch
// Multiple of the rows' own distance. In 15 logs of another plant, and in simulated ones with
// impacts, dead time, clipping and coarse steps, no row reached 10.3.
constexpr double kFar = 20;
constexpr double kSteps = 4;         // steps of the signal: a reading may fall to either side
constexpr std::size_t kFrozen = 32;  // rows
constexpr double kLeap = 4;          // of the largest change after it, and of the signal's steps

bool is_angle(const RawColumn& c) {
  return c.values == &RawLog::theta_m;
}
bool is_voltage(const RawColumn& c) {
  return c.values == &RawLog::u_alpha || c.values == &RawLog::u_beta || c.values == &RawLog::u_d ||
         c.values == &RawLog::u_q;
}
bool is_current(const RawColumn& c) {
  return c.values == &RawLog::i_a || c.values == &RawLog::i_b || c.values == &RawLog::i_c ||
         c.values == &RawLog::i_alpha || c.values == &RawLog::i_beta || c.values == &RawLog::i_d ||
         c.values == &RawLog::i_q;
}

double change(const RawColumn& c, double from, double to) {
  const double way = to - from;  // equal to its remainder up to half a turn
  return is_angle(c) && std::abs(way) > kPi ? std::remainder(way, kTwoPi) : way;
}

// Size of a change; 0 if it is rounding.
double step_of(const RawColumn& c, double from, double to) {
  constexpr double kRounding = 1e-12;  // of the value
  const double step = std::abs(change(c, from, to));
  return step > kRounding * std::abs(to) ? step : 0;
}

// The parabola through kAround rows before and after rows [k, k + rows), as changes from row k - 1.
class Parabola {
 public:
  Parabola(const RawColumn& c, const std::vector<double>& x, std::size_t k, std::size_t rows)
      : centre_(0.5 * static_cast<double>(rows - 1)) {
    for (std::size_t j = 0; j < kAround; ++j) {
      const std::size_t before = k - kAround + j, behind = k + rows + j;
      place_[j] = static_cast<double>(j) - kAround - centre_;
      place_[kAround + j] = static_cast<double>(rows + j) - centre_;
      y_[j] = change(c, x[k - 1], x[before]);
      y_[kAround + j] = change(c, x[k - 1], x[behind]);
    }
    double s2 = 0, s4 = 0, b0 = 0, b1 = 0, b2 = 0;
    for (std::size_t j = 0; j < place_.size(); ++j) {
      const double p2 = place_[j] * place_[j];
      s2 += p2, s4 += p2 * p2;
      b0 += y_[j], b1 += place_[j] * y_[j], b2 += p2 * y_[j];
    }
    const double n = 2 * kAround, det = n * s4 - s2 * s2;
    a0_ = (s4 * b0 - s2 * b2) / det, a1_ = b1 / s2, a2_ = (n * b2 - s2 * b0) / det;
    for (std::size_t j = 0; j < rows; ++j)
      distance_ = std::min(distance_, std::abs(change(c, x[k - 1], x[k + j]) -
                                               at(static_cast<double>(j) - centre_)));
  }
  double distance() const { return distance_; }  // of the rows from it, the smallest
  double of_sides() const {                      // rms distance of the rows before and after
    double sum = 0;
    for (std::size_t j = 0; j < place_.size(); ++j) sum += std::pow(y_[j] - at(place_[j]), 2);
    return std::sqrt(sum / (2 * kAround - 3));  // three parameters
  }

 private:
  double at(double place) const { return a0_ + a1_ * place + a2_ * place * place; }

  double centre_;
  std::array<double, 2 * kAround> place_, y_;
  double a0_ = 0, a1_ = 0, a2_ = 0, distance_ = 1e308;
};

}  // namespace

void Spread::add(double distance) {
  if (!std::isfinite(distance)) return;
  const double place = distance > 0 ? 256 + 4 * std::log2(distance) : 0;
  ++bins_[static_cast<std::size_t>(std::clamp(place, 0.0, 511.0))];
  ++count_;
}

double Spread::sigma() const {
  std::size_t below = 0;
  for (std::size_t bin = 0; bin < bins_.size(); ++bin)
    if (20 * (below += bins_[bin]) >= 19 * count_ && count_ > 0)
      return bin == 0 ? 0 : std::exp2((static_cast<double>(bin) + 0.5 - 256) / 4) / 1.96;
  return 0;
}

// True if a current reading at this row or the one before lies as far off, on the scale of a
// current: the controller responds to it. It also responds to every step of a coarse converter.
bool GlitchScan::asked_for(const RawLog& raw, std::size_t k, double times_usual) const {
  constexpr double kAsFar = 1.0 / 3;
  for (std::size_t c = 0; c < raw_columns().size(); ++c) {
    const RawColumn& column = raw_columns()[c];
    const std::vector<double>& i = raw.*column.values;
    if (!is_current(column) || i.empty()) continue;
    const double far = kAsFar * times_usual * signals_[c].spread.sigma();
    for (const std::size_t row : {k - 1, k})
      if (row >= kAround && row + kAround < i.size() && i[row] != i[row - 1] &&
          Parabola(column, i, row, 1).distance() > far)
        return true;
  }
  return false;
}

// True if the current's slope over the rows differs from that before and after them.
bool GlitchScan::answered(const RawLog& raw, std::size_t k, std::size_t rows) const {
  constexpr double kSigmas = 6;
  for (std::size_t c = 0; c < raw_columns().size(); ++c) {
    const RawColumn& column = raw_columns()[c];
    const std::vector<double>& i = raw.*column.values;
    if (!is_current(column) || i.empty() || k + rows + 2 >= i.size()) continue;
    const double way = i[k + rows] - i[k];
    const double before = i[k] - i[k - 2], behind = i[k + rows + 2] - i[k + rows];
    const double expected = static_cast<double>(rows) * (before + behind) / 4;
    const double noise = std::max(signals_[c].spread.sigma(), 0.5 * signals_[c].step);
    if (std::abs(way - expected) > kSigmas * noise) return true;
  }
  return false;
}

void GlitchScan::look(const RawLog& raw, const std::vector<char>& stale, std::size_t first,
                      std::size_t end, double T_s, std::vector<char>& bad) {
  constexpr double kGap = 1.5;  // of its rows' time: rows are missing, no comparison
  const auto whole = [&](std::size_t k, std::size_t rows) {
    if (k < kAround || k + rows + kAround > raw.size()) return false;
    const std::size_t from = k - kAround, to = k + rows + kAround - 1;
    return raw.t[to] - raw.t[from] < kGap * static_cast<double>(to - from) * T_s;
  };
  // Updates the usual distances before any row is judged; those of currents precede the voltages.
  const std::size_t signals = raw_columns().size();
  std::vector<std::vector<double>> distance_of_one(signals, std::vector<double>(raw.size()));
  for_each_index(signals, [&](std::size_t c) {
    const RawColumn& column = raw_columns()[c];
    const std::vector<double>& x = raw.*column.values;
    if (x.empty()) return;
    Signal& s = signals_[c];
    for (std::size_t k = std::max<std::size_t>(first, 1); k < end; ++k) {
      const double step = step_of(column, x[k - 1], x[k]);
      if (step > 0 && (s.step == 0 || step < s.step)) s.step = step;
      if (!whole(k, 1)) continue;
      distance_of_one[c][k] = Parabola(column, x, k, 1).distance();
      s.spread.add(distance_of_one[c][k]);
    }
  });
  std::vector<std::vector<Candidate>> found(signals);
  std::vector<std::vector<std::size_t>> marked(signals);
  for_each_index(signals, [&](std::size_t c) {
    const RawColumn& column = raw_columns()[c];
    const std::vector<double>& x = raw.*column.values;
    const bool watched = is_current(column) || is_voltage(column) || is_angle(column) ||
                         column.values == &RawLog::v_dc;
    if (x.empty() || !watched) return;
    Signal& s = signals_[c];
    const double usual = s.spread.sigma();
    for (std::size_t k = first; k < end; ++k) {
      if (raw.t[k] <= s.bad_until) {
        marked[c].push_back(k);
        continue;
      }
      const double recently = s.recently;
      for (std::size_t rows = 1; rows <= kLongest; ++rows) {
        if (!whole(k, rows)) break;
        const double distance =
            rows == 1 ? distance_of_one[c][k] : Parabola(column, x, k, rows).distance();
        if (rows == 1) s.recently += (std::min(distance, 4 * recently + usual) - recently) / 64;
        const auto is_far = [&](double scatter) {
          return distance > std::max(kFar * scatter, kSteps * s.step);
        };
        if (!is_far(std::max(usual, recently))) continue;
        const double scatter = std::max({usual, recently, Parabola(column, x, k, rows).of_sides()});
        if (!is_far(scatter)) continue;
        if (stale[k] || x[k] == x[k - 1]) break;
        if (is_voltage(column) && (answered(raw, k, rows) || asked_for(raw, k, distance / scatter)))
          break;
        found[c].push_back({{c, raw.t[k], raw.t[k + rows - 1]}, distance});
        s.bad_until = raw.t[k + rows - 1];
        marked[c].push_back(k);
        break;
      }
    }
  });
  for (std::size_t c = 0; c < signals; ++c) {
    candidates_.insert(candidates_.end(), found[c].begin(), found[c].end());
    for (const std::size_t k : marked[c]) bad[k] = 1;
  }
}

std::vector<SignalFault> GlitchScan::found() const {
  std::vector<SignalFault> faults;
  for (const Candidate& g : candidates_)
    if (g.distance > kFar * signals_[g.fault.column].spread.sigma()) faults.push_back(g.fault);
  return faults;
}

void FrozenScan::judge(Signal& s) {
  if (s.left && 2 * s.changed >= kAfter && s.leap > kLeap * std::max(s.largest, s.step))
    found_.push_back(*s.left);
  s.left.reset();
}

void FrozenScan::add(const RawLog& raw, std::size_t k) {
  for (std::size_t c = 0; c < raw_columns().size(); ++c) {
    const RawColumn& column = raw_columns()[c];
    const std::vector<double>& x = raw.*column.values;
    if (x.empty() || !(is_current(column) || is_angle(column))) continue;
    Signal& s = signals_[c];
    const double step = s.before ? step_of(column, *s.before, x[k]) : 0;
    if (step > 0 && (s.step == 0 || step < s.step)) s.step = step;
    if (s.left) {
      s.largest = std::max(s.largest, step);
      s.changed += step > 0;
      if (++s.since == kAfter) judge(s);
    }
    if (s.before && step == 0) {
      ++s.rows;
      s.run.t_end = raw.t[k];
    } else {
      if (s.rows >= kFrozen) {
        s.left = s.run;
        s.leap = step;
        s.largest = 0;
        s.since = s.changed = 0;
      }
      s.run = {c, raw.t[k], raw.t[k]};
      s.rows = 1;
    }
    s.before = x[k];
  }
}

}  // namespace twinrate
