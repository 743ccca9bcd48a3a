#include "trace/health.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "trace/health_clock.hpp"
#include "trace/health_scan.hpp"
#include "trace/held_currents.hpp"

namespace twinrate {
namespace {

using Column = std::vector<double>;

constexpr std::int64_t kGapEdge = 5000;  // rows at each end of a gap; those between are left out

// At rest with a quiet quantised current, a row or two repeat by chance.
void forgive_at_rest(std::vector<char>& stale, const Column& theta_m) {
  constexpr std::size_t kReach = 8, kByChance = 3;  // rows
  for (std::size_t k = 0, end = 0; k < stale.size(); k = end + 1) {
    for (end = k; end < stale.size() && stale[end];) ++end;
    if (end == k || end - k > kByChance) continue;
    const auto first = theta_m.begin() + static_cast<std::ptrdiff_t>(k - std::min(k, kReach));
    const auto last =
        theta_m.begin() + static_cast<std::ptrdiff_t>(std::min(stale.size(), end + kReach));
    if (std::all_of(first, last, [&](double theta) { return theta == *first; }))
      std::fill(stale.begin() + static_cast<std::ptrdiff_t>(k),
                stale.begin() + static_cast<std::ptrdiff_t>(end), char{0});
  }
}

// After repeated rows a reading may come late, if a row holds the earlier reading and rows are
// repeated in turn: it then lies where an earlier row should, on the line through the rows around.
void mark_late(const RawLog& raw, std::vector<char>& stale) {
  constexpr std::size_t kMostLate = 3;
  constexpr double kNear = 0.25;  // of the motion in one row
  const Column& theta_m = raw.theta_m;
  const auto next = [&](std::size_t k) {
    while (k < stale.size() && stale[k]) ++k;
    return k;
  };
  for (std::size_t k = 1; k < stale.size(); ++k) {
    if (!stale[k]) continue;
    const std::size_t before = k - 1, first = next(k);
    const auto late = [&](std::size_t j, double way) {
      const double rows = static_cast<double>(j - before) - (theta_m[j] - theta_m[before]) / way;
      return rows > 1 - kNear && rows < static_cast<double>(j - before) - kNear;
    };
    for (std::size_t most = kMostLate; most > 0; --most) {
      std::size_t end = first;
      for (std::size_t j = 0; j < most; ++j) end = next(end + 1);
      if (end >= stale.size()) continue;
      const double way = (theta_m[end] - theta_m[before]) / static_cast<double>(end - before);
      bool all = true;
      for (std::size_t j = first; j < end; j = next(j + 1)) all &= late(j, way);
      if (!all) continue;
      std::fill(stale.begin() + static_cast<std::ptrdiff_t>(first),
                stale.begin() + static_cast<std::ptrdiff_t>(end), char{1});
      break;
    }
    k = next(first) - 1;
  }
}

// Motion of the angle that rows [first, end) miss, in rad, at the slower of the speeds on their two
// sides. The speeds come from the rows outside, because repeated rows belong to an earlier time. If
// the rotor reverses, it is the deviation from the path in between: two rows at equal distances
// from the reversal have equal angles, and a current at its limit repeats with them. 0 without a
// side.
double missed_way(const Column& theta_m, std::size_t first, std::size_t end) {
  constexpr std::size_t kRows = 4;
  if (first <= kRows || end + kRows >= theta_m.size()) return 0;
  const auto way = [&](std::size_t from) {
    return (theta_m[from + kRows] - theta_m[from]) / static_cast<double>(kRows);
  };
  const double before = way(first - 1 - kRows), behind = way(end),
               rows = static_cast<double>(end - first);
  if (before * behind >= 0) return rows * std::min(std::abs(before), std::abs(behind));
  const double bend = std::abs(behind - before) / (rows + kRows + 1);  // rad a row, each row
  return bend * (rows * rows - 1) / 8;
}

// The smallest change from one row to the next.
double smallest_step(const Column& x) {
  double step = std::numeric_limits<double>::infinity();
  for (std::size_t k = 1; k < x.size(); ++k)
    if (x[k] != x[k - 1]) step = std::min(step, std::abs(x[k] - x[k - 1]));
  return step;
}

// Whether sampled rows are equal by themselves so often, or for so long, judged by as many rows on
// either side of a run: chance makes such a run in more than one of a thousand logs, or no signal
// covers more than two of its steps.
class EqualRows {
 public:
  EqualRows(const RawLog& raw, const std::vector<char>& stale) : stale_(stale) {
    for (const Column* x : {&raw.theta_m, &raw.i_a, &raw.i_b, &raw.i_c, &raw.i_alpha, &raw.i_beta,
                            &raw.i_d, &raw.i_q})
      if (!x->empty()) signals_.push_back({x, smallest_step(*x)});
  }
  bool by_themselves(std::size_t first, std::size_t end) const {
    constexpr double kChance = 1e-3;
    constexpr std::size_t kAlways = 3;  // rows
    const std::size_t rows = end - first, from = first - std::min(first, rows),
                      to = std::min(stale_.size(), end + rows);
    if (rows <= kAlways || stands(from, to)) return true;
    const auto begin = stale_.begin() + static_cast<std::ptrdiff_t>(from);
    const auto window = static_cast<std::ptrdiff_t>(to - from);
    const auto others = static_cast<double>(to - from - rows);
    const double equal =
        static_cast<double>(std::count(begin, begin + window, 1)) - static_cast<double>(rows);
    const double share = (equal + 1) / (others + 2);
    return static_cast<double>(stale_.size()) * std::pow(share, static_cast<double>(rows)) >
           kChance;
  }

 private:
  bool stands(std::size_t from, std::size_t to) const {
    constexpr double kSteps = 2.5;
    return std::all_of(signals_.begin(), signals_.end(), [&](const auto& signal) {
      const auto begin = signal.first->begin();
      const auto [least, most] = std::minmax_element(begin + static_cast<std::ptrdiff_t>(from),
                                                     begin + static_cast<std::ptrdiff_t>(to));
      return *most == *least || *most - *least < kSteps * signal.second;
    });
  }

  const std::vector<char>& stale_;
  std::vector<std::pair<const Column*, double>> signals_;  // with its smallest step
};

// Missed angle of each run of stale rows. At rest a long run with an end on both sides is stale
// whatever the angle, unless rows are equal by themselves. A run from the first row on may be a
// drive that is off.
std::vector<double> missed_ways(const RawLog& raw, const std::vector<char>& stale) {
  constexpr std::size_t kBefore = 3;  // rows
  const EqualRows equal(raw, stale);
  std::vector<double> missed(stale.size(), 0);
  for (std::size_t k = 0, end = 0; k < stale.size(); k = end + 1) {
    for (end = k; end < stale.size() && stale[end];) ++end;
    if (end == k) continue;
    const double way = raw.theta_m.empty() ? 0 : missed_way(raw.theta_m, k, end);
    const bool inside = end < stale.size();
    const bool sure =
        raw.theta_m.empty() || (way == 0 && k > kBefore && inside && !equal.by_themselves(k, end));
    std::fill(missed.begin() + static_cast<std::ptrdiff_t>(k),
              missed.begin() + static_cast<std::ptrdiff_t>(end), sure ? kSureWay : way);
  }
  return missed;
}

bool has_phases(const RawLog& raw) {
  return !raw.i_a.empty() && !raw.i_b.empty();
}
bool has_stator(const RawLog& raw) {
  return !raw.i_alpha.empty() && !raw.i_beta.empty();
}

// Chance repeats rows that differ by little, for which a held current does no harm.
bool is_held(const CurrentPair& pair, double i_lsb) {
  constexpr double kSteps = 3;
  return pair.looks_held() && pair.way.norm() > kSteps * i_lsb;
}

double interpolate(double a, double b, double share) {
  return a + (b - a) * share;
}

// Glitches and frozen stretches become straight lines between the rows around them.
void mend(RawLog& raw, const SignalFault& fault) {
  std::vector<double>& x = raw.*raw_columns()[fault.column].values;
  const auto row = [&](auto place) { return static_cast<std::size_t>(place - raw.t.begin()); };
  const std::size_t first = row(std::lower_bound(raw.t.begin(), raw.t.end(), fault.t_begin)),
                    end = row(std::upper_bound(raw.t.begin(), raw.t.end(), fault.t_end));
  if (x.empty() || first >= end) return;
  const double before = first > 0 ? x[first - 1] : end < raw.size() ? x[end] : 0;
  const double behind = end < raw.size() ? x[end] : before;
  for (std::size_t k = first; k < end; ++k)
    x[k] = interpolate(before, behind,
                       static_cast<double>(k - first + 1) / static_cast<double>(end - first + 1));
}

// The log without the faults, at even times.
RawLog mended(const RawLog& raw, int n_p, const Health& health) {
  RawLog whole = raw;
  for (const SignalFault& fault : health.glitches) mend(whole, fault);
  for (const SignalFault& fault : health.frozen) mend(whole, fault);
  return health.uneven ? even_rows(whole, n_p, health.T_s) : whole;
}

// Rows in stretches too long for a straight line.
std::vector<char> left_out(const RawLog& raw, const Health& health) {
  constexpr double kBridged = 1.5;  // T_s from the first to the last row of two
  std::vector<char> out(raw.size(), 0);
  const auto mark = [&](const SignalFault& fault) {
    const auto first = std::lower_bound(raw.t.begin(), raw.t.end(), fault.t_begin),
               last = std::upper_bound(raw.t.begin(), raw.t.end(), fault.t_end);
    std::fill(out.begin() + (first - raw.t.begin()), out.begin() + (last - raw.t.begin()), char{1});
  };
  for (const SignalFault& fault : health.glitches)
    if (fault.t_end - fault.t_begin > kBridged * health.T_s) mark(fault);
  for (const SignalFault& fault : health.frozen) mark(fault);
  return out;
}

}  // namespace

void Health::combine(const Health& other) {
  const double a = static_cast<double>(rows), b = static_cast<double>(other.rows);
  const auto mean = [&](double x, double y) { return (a * x + b * y) / std::max(1.0, a + b); };
  missing_share = mean(missing_share, other.missing_share);
  stale_share = mean(stale_share, other.stale_share);
  held_share = mean(held_share, other.held_share);
  clipped_share = mean(clipped_share, other.clipped_share);
  jitter = mean(jitter, other.jitter);
  i_lsb = std::max(i_lsb, other.i_lsb);
  if (other.angle.lsb > angle.lsb) angle = other.angle;
  i_limit = std::max(i_limit, other.i_limit);
  i_sum_max = std::max(i_sum_max, other.i_sum_max);
  i_digit = std::max(i_digit, other.i_digit);
  speed_lag = std::max(speed_lag, other.speed_lag);
  if (speed_scale == 1) speed_scale = other.speed_scale;
  if (T_s == 0) T_s = other.T_s;
  stray |= other.stray;
  uneven |= other.uneven;
  no_angle |= other.no_angle;
  i_q_alone |= other.i_q_alone;
  if (other.hidden_turns) hidden_turns = std::max(hidden_turns.value_or(0), *other.hidden_turns);
  pauses.insert(pauses.end(), other.pauses.begin(), other.pauses.end());
  glitches.insert(glitches.end(), other.glitches.begin(), other.glitches.end());
  frozen.insert(frozen.end(), other.frozen.begin(), other.frozen.end());
  // A signal that changes in one of the logs is alive.
  if (rows == 0) {
    constant = other.constant;
    blind = other.blind;
  }
  std::erase_if(constant, [&](std::size_t column) {
    return std::count(other.constant.begin(), other.constant.end(), column) == 0;
  });
  if (other.blind.empty()) blind.clear();
  rows += other.rows;
}

std::span<const RawColumn> raw_columns() {
  static constexpr RawColumn kColumns[] = {
      {"i_a", &RawLog::i_a},         {"i_b", &RawLog::i_b},
      {"i_c", &RawLog::i_c},         {"i_alpha", &RawLog::i_alpha},
      {"i_beta", &RawLog::i_beta},   {"i_d", &RawLog::i_d},
      {"i_q", &RawLog::i_q},         {"u_alpha", &RawLog::u_alpha},
      {"u_beta", &RawLog::u_beta},   {"u_d", &RawLog::u_d},
      {"u_q", &RawLog::u_q},         {"v_dc", &RawLog::v_dc},
      {"theta_m", &RawLog::theta_m}, {"omega_m", &RawLog::omega_m},
      {"T_load", &RawLog::T_load},   {"temperature", &RawLog::temperature}};
  return kColumns;
}

void RawLog::append(const RawLog& piece) {
  no_angle |= piece.no_angle;
  load_measured |= piece.load_measured;
  t.insert(t.end(), piece.t.begin(), piece.t.end());
  for (const RawColumn& c : raw_columns())
    (this->*c.values)
        .insert((this->*c.values).end(), (piece.*c.values).begin(), (piece.*c.values).end());
}

void RawLog::drop_first(std::size_t rows) {
  const auto drop = [&](std::vector<double>& x) {
    x.erase(x.begin(), x.begin() + static_cast<std::ptrdiff_t>(std::min(rows, x.size())));
  };
  drop(t);
  for (const RawColumn& c : raw_columns()) drop(this->*c.values);
}

Record make_record(const RawLog& raw, int n_p, Health& health, int encoder_counts) {
  HealthScan scan(encoder_counts);
  scan.add(raw);
  health = scan.health();
  return record_of(raw, n_p, health);
}

RepeatedRows repeated_rows(const RawLog& raw) {
  std::vector<const Column*> noisy;
  for (const Column* c :
       {&raw.i_a, &raw.i_b, &raw.i_c, &raw.i_alpha, &raw.i_beta, &raw.i_d, &raw.i_q, &raw.v_dc})
    if (!c->empty()) noisy.push_back(c);
  const Column& theta_m = raw.theta_m;
  RepeatedRows rows;
  rows.stale.resize(raw.size(), 0);
  rows.by_chance.resize(raw.size(), 0);
  if (noisy.size() + !theta_m.empty() < 2) return rows;
  const auto same = [&](std::size_t k, std::size_t as) {
    return std::all_of(noisy.begin(), noisy.end(),
                       [&](const Column* c) { return (*c)[k] == (*c)[as]; });
  };
  // By chance, the angle repeats one of the two: a count that lasts two rows does not last three.
  for (std::size_t k = 1; k < raw.size(); ++k) {
    const auto stands = [&](std::size_t as) {
      return theta_m.empty() || theta_m[k] == theta_m[as];
    };
    rows.stale[k] = stands(k - 1) && same(k, k - 1);
    rows.by_chance[k] =
        k > 1 && !rows.stale[k] && same(k, k - 2) && (stands(k - 1) || stands(k - 2));
  }
  if (!theta_m.empty()) {
    forgive_at_rest(rows.stale, raw.theta_m);
    forgive_at_rest(rows.by_chance, raw.theta_m);
  }
  rows.missed_way = missed_ways(raw, rows.stale);
  if (theta_m.empty()) return rows;
  mark_late(raw, rows.stale);
  // A late row belongs to the run before it.
  for (std::size_t k = 1; k < raw.size(); ++k)
    if (rows.stale[k] && rows.missed_way[k] == 0) rows.missed_way[k] = rows.missed_way[k - 1];
  return rows;
}

bool beyond_counts(double missed_way, double lsb) {
  constexpr double kCounts = 1.5;  // 1.25 and more over four rows are needed; no count lasts longer
  return missed_way > kCounts * lsb;
}

bool is_chance(std::size_t stale, std::size_t by_chance) {
  constexpr std::size_t kTimes = 4;
  return kTimes * by_chance > stale;
}

void expect_signals(const RawLog& raw) {
  const bool has_u =
      (!raw.u_alpha.empty() && !raw.u_beta.empty()) || (!raw.u_d.empty() && !raw.u_q.empty());
  if (raw.theta_m.empty()) throw std::runtime_error(raw.path + ": no theta_m in the log");
  if (!has_phases(raw) && !has_stator(raw) && raw.i_q.empty())
    throw std::runtime_error(raw.path +
                             ": no current in the log (i_a and i_b, i_alpha and i_beta, or i_q)");
  if (raw.no_angle && !has_u)
    throw std::runtime_error(raw.path +
                             ": no theta_m in the log, and no voltage (u_alpha and u_beta, or u_d "
                             "and u_q) that would do without it at standstill");
}

Record record_of(const RawLog& measured, int n_p, const Health& health) {
  expect_signals(measured);
  const bool as_it_is = health.glitches.empty() && health.frozen.empty() && !health.uneven;
  const RawLog changed = as_it_is ? RawLog{} : mended(measured, n_p, health);
  const RawLog& raw = as_it_is ? measured : changed;
  const std::vector<char> bad = left_out(raw, health);
  const std::size_t rows = raw.t.size();
  const bool phases = has_phases(raw), stator = has_stator(raw);
  Record record;
  record.source = raw.path;
  record.T_s = health.T_s;
  record.angle = health.angle;

  RepeatedRows repeated = repeated_rows(raw);
  std::vector<char>& stale = repeated.stale;
  const auto count = [](const std::vector<char>& x) {
    return static_cast<std::size_t>(std::count(x.begin(), x.end(), 1));
  };
  for (std::size_t k = 0; k < rows; ++k)
    stale[k] = stale[k] && beyond_counts(repeated.missed_way[k], health.angle.lsb);
  if (!health.blind.empty() || is_chance(count(stale), count(repeated.by_chance)))
    std::fill(stale.begin(), stale.end(), 0);
  // Current and voltage in stator axes, row by row of the file.
  std::vector<Vec2> i(rows), u(rows);
  std::vector<char> clipped(rows, 0);
  const bool three_sensors = phases && health.i_c_measured();
  const bool has_u =
      (!raw.u_alpha.empty() && !raw.u_beta.empty()) || (!raw.u_d.empty() && !raw.u_q.empty());
  for (std::size_t k = 0; k < rows; ++k) {
    const double theta_e = n_p * raw.theta_m[k];
    if (phases) {
      const double i_c = raw.i_c.empty() ? -(raw.i_a[k] + raw.i_b[k]) : raw.i_c[k];
      i[k] = clarke({raw.i_a[k], raw.i_b[k], i_c});
      if (health.i_limit > 0) {
        const double level = health.i_limit * (1 - 1e-9) - 1e-6 * health.i_limit;
        clipped[k] = std::abs(raw.i_a[k]) >= level || std::abs(raw.i_b[k]) >= level ||
                     (three_sensors && std::abs(i_c) >= level);
      }
    } else if (stator) {
      i[k] = {raw.i_alpha[k], raw.i_beta[k]};
    } else {
      i[k] = inverse_park({raw.i_d.empty() ? 0 : raw.i_d[k], raw.i_q[k]}, theta_e);
    }
    if (!has_u) continue;
    u[k] = raw.u_alpha.empty() ? inverse_park({raw.u_d[k], raw.u_q[k]}, theta_e)
                               : Vec2(raw.u_alpha[k], raw.u_beta[k]);
  }
  if (health.held_share > 0)
    for (std::size_t k = 1; k + 1 < rows; ++k)
      if (!stale[k] && !clipped[k] && is_held(current_pair(raw, k, health.T_s), health.i_lsb))
        i[k] = (i[k - 1] + i[k + 1]) / 2;
  record.current_sensors = phases && !three_sensors ? 2 : 3;
  record.load_measured = raw.load_measured;
  const bool full_current = phases || stator || !raw.i_d.empty();
  record.i_q_alone = !full_current;

  // Resamples onto the even grid.
  std::vector<std::size_t> kept;  // rows of the file that are not stale
  for (std::size_t k = 0; k < rows; ++k)
    if (!stale[k]) kept.push_back(k);
  const auto push = [&](double t, std::size_t a, std::size_t b, double share, bool ok) {
    const double theta_m = interpolate(raw.theta_m[a], raw.theta_m[b], share);
    const auto turned = [&](const Vec2& x, std::size_t from) -> Vec2 {
      return share > 0 ? inverse_park(x, n_p * (theta_m - raw.theta_m[from])) : x;
    };
    record.t.push_back(t);
    record.theta_m.push_back(theta_m + health.angle.centre);
    record.i_alphabeta.push_back((1 - share) * turned(i[a], a) + share * turned(i[b], b));
    // Without a sample, a controller may apply another voltage than the next row's.
    if (has_u) record.u_alphabeta.push_back(turned(u[a], a));
    if (!raw.v_dc.empty()) record.v_dc.push_back(interpolate(raw.v_dc[a], raw.v_dc[b], share));
    if (!raw.T_load.empty())
      record.T_load.push_back(interpolate(raw.T_load[a], raw.T_load[b], share));
    ok &= !clipped[a] && !clipped[b] && !bad[a] && !bad[b];
    record.electrical_ok.push_back(ok);
    record.motion_ok.push_back(ok && !raw.no_angle);
  };
  // If the stamps stray, time follows the rows.
  EvenGrid grid;
  for (std::size_t m = 0; m < kept.size(); ++m) {
    const std::size_t k = kept[m];
    double t = raw.t[k];
    if (m > 0) {
      const std::size_t before = kept[m - 1];
      const double from = health.stray ? record.t.back() : raw.t[before];
      const auto steps =
          health.stray ? grid.steps_to(raw.t[k], record.T_s)
                       : std::max<std::int64_t>(1, std::llround((raw.t[k] - from) / record.T_s));
      const double span = health.stray ? static_cast<double>(steps) * record.T_s : raw.t[k] - from;
      for (std::int64_t j = 1; j < steps; ++j) {
        if (j == kGapEdge) j = std::max(j, steps - kGapEdge);
        const double share = static_cast<double>(j) / static_cast<double>(steps);
        push(from + share * span, before, k, share, steps <= 3);
      }
      t = from + span;
    } else {
      grid.steps_to(t, record.T_s);
    }
    push(t, k, k, 0, true);
  }
  if (!full_current || !has_u) record.u_alphabeta.clear();
  return record;
}

}  // namespace twinrate
