#include "trace/health_scan.hpp"

#include <algorithm>
#include <cmath>

#include "model/frames.hpp"

namespace twinrate {
namespace {

constexpr double kBin = 0.01;      // of the logarithm of a time step
constexpr double kSameStep = 0.3;  // of the median
constexpr std::size_t kMostValues = 1 << 17;

double tolerance(double level) {
  return 1e-6 * level + 1e-9;
}

constexpr double kWayBin = 0.02;  // of the logarithm of the missed angle

// A logger that loses rows does so more than three times in a log. A loss at random, even of half of
// the rows, takes no 20 in succession.
constexpr std::size_t kPauseRows = 20, kMostPauses = 3;

int missed_bin(double way) {
  return static_cast<int>(std::floor(std::log(way) / kWayBin));
}

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace

void SamplingInterval::add(double step) {
  Bin& bin = bins_[static_cast<int>(std::floor(std::log(step) / kBin))];
  ++bin.count;
  bin.sum += step;
  ++count_;
}

double SamplingInterval::mean() const {
  double typical = 0;
  std::size_t below = 0;
  for (const auto& [place, bin] : bins_) {
    typical = bin.sum / static_cast<double>(bin.count);
    if (2 * (below += bin.count) > count_) break;
  }
  double sum = 0;
  std::size_t count = 0;
  for (const auto& [place, bin] : bins_)
    if (std::abs(bin.sum / static_cast<double>(bin.count) - typical) < kSameStep * typical)
      sum += bin.sum, count += bin.count;
  return sum / static_cast<double>(std::max<std::size_t>(count, 1));
}

void CurrentLevels::add(double value) {
  const double size = std::abs(value);
  if (size > top_ + tolerance(top_)) {
    next_ = top_;
    at_next_ = at_top_;
    top_ = size;
    at_top_ = run_ = in_runs_ = visits_ = 0;
  }
  const bool here = size > top_ - tolerance(top_);
  at_top_ += here;
  run_ = here ? run_ + 1 : 0;
  if (run_ == 1) ++visits_;
  if (run_ == 4) in_runs_ += 4;
  if (run_ > 4) ++in_runs_;
  if (here || size <= next_ - tolerance(top_)) return;
  if (size > next_ + tolerance(top_)) {
    next_ = size;
    at_next_ = 0;
  }
  ++at_next_;
}

double CurrentLevels::limit(double times) const {
  // The top step of a coarse scale alone has no more samples than the step below it.
  return in_runs_ >= 12 && 4 * in_runs_ > at_top_ &&
                 static_cast<double>(at_top_) > times * static_cast<double>(at_next_)
             ? top_
             : 0;
}

// The common limit of two sensors that few rows in succession hold, in a log of few rows a second; 0:
// none. A sine has at most 2.4 times as many samples in its top step as in the next.
double common_limit(const CurrentLevels& a, const CurrentLevels& b) {
  constexpr std::size_t kVisits = 4, kTimes = 5;
  if (std::abs(a.top() - b.top()) > tolerance(a.top()) ||
      std::min(a.visits(), b.visits()) < kVisits ||
      a.at_top() + b.at_top() <= kTimes * (a.just_below() + b.just_below()))
    return 0;
  return std::min(a.top(), b.top());
}

void CurrentValues::add(double value) {
  ++count_;
  if (!quantised_) return;
  values_.emplace(std::llround(value / kSameCurrent), value);
  quantised_ = values_.size() <= kMostValues;
  if (!quantised_) values_.clear();
}

double CurrentValues::step() const {
  std::vector<double> values, steps;
  for (const auto& [key, value] : values_) values.push_back(value);
  std::sort(values.begin(), values.end());
  for (std::size_t k = 1; k < values.size(); ++k)
    if (values[k] - values[k - 1] > kSameCurrent) steps.push_back(values[k] - values[k - 1]);
  if (steps.size() < 2 || steps.size() > count_ / 10) return 0;
  const double step = median(steps);
  const auto near = std::count_if(steps.begin(), steps.end(), [&](double s) {
    return std::abs(s / step - std::round(s / step)) < 0.05;
  });
  return 10 * near > 9 * static_cast<std::ptrdiff_t>(steps.size()) ? step : 0;
}

void HealthScan::look_at_currents(std::size_t k) {
  const double i_a = ahead_.i_a[k], i_b = ahead_.i_b[k];
  const double i_c = ahead_.i_c.empty() ? -(i_a + i_b) : ahead_.i_c[k];
  i_sum_max_ = std::max(i_sum_max_, std::abs(i_a + i_b + i_c));
  for (double i : {i_a, i_b}) decimals_.add(i);
  a_.add(i_a);
  b_.add(i_b);
  const double largest = std::max(std::abs(i_a), std::abs(i_b));
  any_.add(i_sum_max_ > Health::kSumOfPhases ? std::max(largest, std::abs(i_c)) : largest);
  values_a_.add(i_a);
}

// At its limit a clipped current is constant without being held.
bool HealthScan::at_top(std::size_t k) const {
  if (ahead_.i_a.empty() || ahead_.i_b.empty()) return false;
  const auto near = [](const CurrentLevels& levels, double i) {
    return std::abs(i) > levels.top() - tolerance(levels.top());
  };
  return near(a_, ahead_.i_a[k]) || near(b_, ahead_.i_b[k]);
}

void HealthScan::add(const RawLog& piece) {
  for (double t : piece.t) {
    if (t_before_) interval_.add(t - *t_before_);
    t_before_ = t;
  }
  ahead_.append(piece);
  take(std::max(taken_, ahead_.size() - std::min(ahead_.size(), kStaleReach)));
  const std::size_t done = taken_ - std::min(taken_, kStaleReach);
  ahead_.drop_first(done);
  taken_ -= done;
}

void HealthScan::take(std::size_t end) {
  const double T_s = interval_.mean();
  const bool phases = !ahead_.i_a.empty() && !ahead_.i_b.empty();
  const auto [stale, by_chance, missed_way] = repeated_rows(ahead_);
  std::vector<char> bad(ahead_.size(), 0);
  glitches_.look(ahead_, stale, taken_, end, T_s, bad);
  for (std::size_t k = taken_; k < end; ++k) {
    ++rows_;
    ++rows_since_kept_;
    if (phases && !bad[k]) look_at_currents(k);
    by_chance_ += by_chance[k] != 0;
    if (stale[k]) {
      if (missed_way[k] > 0) ++stale_[missed_bin(missed_way[k])];
      continue;
    }
    if (!ahead_.theta_m.empty() && !bad[k]) angle_.add(ahead_.theta_m[k]);
    frozen_.add(ahead_, k);
    clock_.add(ahead_.t[k], ahead_.theta_m.empty() ? nullptr : &ahead_.theta_m[k], T_s);
    for (std::size_t c = 0; c < ranges_.size(); ++c)
      if (const auto& x = ahead_.*raw_columns()[c].values; !x.empty()) {
        ranges_[c].lowest = std::min(ranges_[c].lowest, x[k]);
        ranges_[c].highest = std::max(ranges_[c].highest, x[k]);
      }
    const bool angle_moves =
        k > 0 && !ahead_.theta_m.empty() && ahead_.theta_m[k] != ahead_.theta_m[k - 1];
    if (!at_top(k)) held_.add(current_pair(ahead_, k, T_s), angle_moves);
    if (t_kept_) {
      const double span = (ahead_.t[k] - *t_kept_) / T_s;
      const auto steps = std::max<std::int64_t>(1, std::llround(span));
      const auto missing =
          static_cast<std::size_t>(std::max<std::int64_t>(0, steps - rows_since_kept_));
      missing_ += missing;
      const auto note = [&](std::vector<Pause>& gaps) {
        if (gaps.size() <= kMostPauses) gaps.push_back({*t_kept_, ahead_.t[k]});
      };
      if (missing > 0) note(gaps_);
      if (missing > kPauseRows) {
        note(pauses_);
        in_pauses_ += missing;
      }
      jitter_ += std::pow(span - static_cast<double>(steps), 2);
    }
    if (!ahead_.omega_m.empty() && !ahead_.theta_m.empty() && !bad[k])
      speed_.add(ahead_.t[k], ahead_.theta_m[k], ahead_.omega_m[k], T_s);
    t_kept_ = ahead_.t[k];
    rows_since_kept_ = 0;
    ++kept_;
  }
  taken_ = end;
}

Health HealthScan::health() const {
  HealthScan rest = *this;
  rest.take(rest.ahead_.size());
  return rest.result();
}

// Nothing can be traced if no current changes, or if a phase current is constant while the rotor
// turns.
void HealthScan::look_for_dead_signals(Health& h) const {
  std::string standing;
  std::size_t currents = 0, dead = 0;
  bool phase_stands = false, all_zero = true;
  Range angle;
  for (std::size_t c = 0; c < ranges_.size(); ++c) {
    const std::string name = raw_columns()[c].name;
    const Range& range = ranges_[c];
    if (range.highest < range.lowest) continue;  // not in the log
    if (name == "theta_m") angle = range;
    const bool current = name.starts_with("i_");
    if (range.constant() && (current || (name == "theta_m" && !h.no_angle)))
      h.constant.push_back(c);
    if (!current) continue;
    ++currents;
    if (!range.constant()) continue;
    ++dead;
    standing += (standing.empty() ? "" : ", ") + name;
    phase_stands |= name != "i_d" && name != "i_q";
    all_zero &= range.lowest == 0;
  }
  const bool turns = angle.highest - angle.lowest > kPi;
  if (dead == 0 || (dead < currents && !(phase_stands && turns))) return;
  h.blind = dead == currents && all_zero
                ? "no current flows: " + standing + " is 0 in every row"
                : standing + " has the same value in every row; a measured current would vary";
  h.i_limit = h.i_lsb = h.clipped_share = 0;
}

Health HealthScan::result() const {
  Health h{.rows = rows_, .T_s = interval_.mean()};
  const auto share = [](std::size_t part, std::size_t whole) {
    return static_cast<double>(part) / static_cast<double>(std::max<std::size_t>(1, whole));
  };
  const bool few = gaps_.size() <= kMostPauses, pauses = pauses_.size() <= kMostPauses;
  const std::size_t paused = few ? missing_ : pauses ? in_pauses_ : 0;
  h.pauses = few ? gaps_ : pauses ? pauses_ : std::vector<Pause>{};
  const auto lost = [&](std::size_t missing) {
    const std::size_t left = missing - std::min(missing, paused);
    return share(left, rows_ + left);
  };
  h.missing_share = lost(missing_);
  h.i_lsb = values_a_.step();
  h.angle = angle_.sensor();
  std::size_t stale = 0;
  for (const auto& [bin, count] : stale_)
    if (beyond_counts(std::exp((bin + 0.5) * kWayBin), h.angle.lsb)) stale += count;
  // A single stale row is no evidence, even if no row was seen to repeat by chance.
  h.stale_share = is_chance(stale, by_chance_ + 1) ? 0 : share(stale, rows_);
  h.held_share = held_.share(h.i_lsb);
  h.i_limit = std::max(a_.limit(), b_.limit());
  // On a coarse scale the step below the limit has many samples, too. The top step of a sine has at
  // most 2.4 times as many, and the two sensors have the same top.
  constexpr double kTimesCoarse = 3;
  if (h.i_limit == 0 && std::abs(a_.top() - b_.top()) < tolerance(a_.top()))
    h.i_limit = std::min(a_.limit(kTimesCoarse), b_.limit(kTimesCoarse));
  if (h.i_limit == 0) h.i_limit = common_limit(a_, b_);
  if (h.i_limit > 0) {
    const bool both = std::abs(any_.top() - h.i_limit) < tolerance(h.i_limit);
    h.clipped_share = share(both             ? any_.at_top()
                            : a_.limit() > 0 ? a_.at_top()
                                             : b_.at_top(),
                            rows_);
  }
  const SpeedAgainstAngle::Difference speed = speed_.difference();
  h.speed_lag = speed.lag_s;
  h.speed_scale = speed.scale;
  h.hidden_turns = speed.hidden_turns;
  h.jitter = std::sqrt(jitter_ / static_cast<double>(std::max<std::size_t>(1, kept_)));
  h.i_sum_max = i_sum_max_;
  h.i_digit = decimals_.digit();
  if (const ClockScan::Stamps stamps = clock_.result(h.T_s); stamps.stray) {
    h.T_s = stamps.T_s;
    h.jitter = stamps.jitter;
    h.uneven = stamps.uneven;
    h.stray = !stamps.uneven;
    h.missing_share = lost(stamps.missing);
  }
  h.glitches = glitches_.found();
  h.frozen = frozen_.found();
  if (!h.frozen.empty())
    h.speed_lag = 0, h.speed_scale = 1, h.hidden_turns = {};  // compared with a frozen signal
  h.no_angle = ahead_.no_angle;
  h.i_q_alone =
      !ahead_.i_q.empty() && ahead_.i_d.empty() && ahead_.i_alpha.empty() && ahead_.i_a.empty();
  look_for_dead_signals(h);
  return h;
}

}  // namespace twinrate
