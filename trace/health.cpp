#include "trace/health.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>

namespace twinrate {
namespace {

using Column = std::vector<double>;

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

double sampling_interval(const Column& t) {
  std::vector<double> steps;
  for (std::size_t k = 1; k < t.size(); ++k) steps.push_back(t[k] - t[k - 1]);
  const double typical = median(steps);
  // The mean of the steps that are one interval: time stamps are rounded to few digits.
  double sum = 0;
  std::size_t count = 0;
  for (double step : steps)
    if (std::abs(step - typical) < 0.3 * typical) sum += step, ++count;
  return sum / static_cast<double>(std::max<std::size_t>(count, 1));
}

// Rows that repeat the row before in every signal that has noise.
std::vector<char> stale_rows(const std::vector<const Column*>& noisy, std::size_t n) {
  std::vector<char> stale(n, 0);
  if (noisy.size() < 2) return stale;
  for (std::size_t k = 1; k < n; ++k)
    stale[k] = std::all_of(noisy.begin(), noisy.end(),
                           [&](const Column* c) { return (*c)[k] == (*c)[k - 1]; });
  return stale;
}

// Where the angle stands still and a quantised current is quiet, a row or two repeat by chance.
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

// Step between the values of a quantised signal, 0 where it is not quantised.
double step_of(const Column& x) {
  std::vector<double> values(x.begin(), x.end());
  std::sort(values.begin(), values.end());
  std::vector<double> steps;
  for (std::size_t k = 1; k < values.size(); ++k)
    if (values[k] - values[k - 1] > 1e-7) steps.push_back(values[k] - values[k - 1]);
  if (steps.size() < 2 || steps.size() > x.size() / 10) return 0;
  const double step = median(steps);
  const auto near = std::count_if(steps.begin(), steps.end(), [&](double s) {
    return std::abs(s / step - std::round(s / step)) < 0.05;
  });
  return 10 * near > 9 * static_cast<std::ptrdiff_t>(steps.size()) ? step : 0;
}

// The level at which many neighbouring rows stand still at the top; 0 where there is none.
double clip_level(const Column& x) {
  double top = 0;
  for (double value : x) top = std::max(top, std::abs(value));
  const double tolerance = 1e-6 * top + 1e-9;
  std::size_t at_top = 0, in_runs = 0, run = 0, below = 0;
  double next = 0;  // the level below
  for (double value : x)
    if (std::abs(value) < top - tolerance) next = std::max(next, std::abs(value));
  for (double value : x) {
    const bool here = std::abs(value) > top - tolerance;
    at_top += here;
    below += std::abs(value) > next - tolerance && !here;
    run = here ? run + 1 : 0;
    if (run == 4) in_runs += 4;
    if (run > 4) ++in_runs;
  }
  // Samples pile up at a limit; at the top of a mere coarse scale there are no more than below it.
  return in_runs >= 12 && 4 * in_runs > at_top && at_top > 5 * below ? top : 0;
}

double interpolate(double a, double b, double share) {
  return a + (b - a) * share;
}

}  // namespace

void Health::combine(const Health& other) {
  const double a = static_cast<double>(rows), b = static_cast<double>(other.rows);
  const auto mean = [&](double x, double y) { return (a * x + b * y) / std::max(1.0, a + b); };
  missing_share = mean(missing_share, other.missing_share);
  stale_share = mean(stale_share, other.stale_share);
  clipped_share = mean(clipped_share, other.clipped_share);
  jitter = mean(jitter, other.jitter);
  i_lsb = std::max(i_lsb, other.i_lsb);
  i_limit = std::max(i_limit, other.i_limit);
  rows += other.rows;
}

Record make_record(const RawLog& raw, int n_p, Health& health) {
  const std::size_t rows = raw.t.size();
  if (raw.theta_m.empty()) throw std::runtime_error(raw.path + ": no theta_m in the log");
  const bool phases = !raw.i_a.empty() && !raw.i_b.empty();
  const bool stator = !raw.i_alpha.empty() && !raw.i_beta.empty();
  const bool rotor = !raw.i_q.empty();
  if (!phases && !stator && !rotor)
    throw std::runtime_error(raw.path +
                             ": no current in the log (i_a and i_b, i_alpha and i_beta, or i_q)");
  health.rows = rows;
  Record record;
  record.source = raw.path;
  record.T_s = sampling_interval(raw.t);

  std::vector<const Column*> noisy;
  for (const Column* c :
       {&raw.i_a, &raw.i_b, &raw.i_alpha, &raw.i_beta, &raw.i_d, &raw.i_q, &raw.v_dc, &raw.theta_m})
    if (!c->empty()) noisy.push_back(c);
  std::vector<char> stale = stale_rows(noisy, rows);
  forgive_at_rest(stale, raw.theta_m);
  if (phases) {
    health.i_lsb = step_of(raw.i_a);
    health.i_limit = std::max(clip_level(raw.i_a), clip_level(raw.i_b));
  }
  // Current and voltage in stator axes, row by row of the file.
  std::vector<Vec2> i(rows), u(rows);
  std::vector<char> clipped(rows, 0);
  double sum_max = 0;
  const bool has_u =
      (!raw.u_alpha.empty() && !raw.u_beta.empty()) || (!raw.u_d.empty() && !raw.u_q.empty());
  for (std::size_t k = 0; k < rows; ++k) {
    const double theta_e = n_p * raw.theta_m[k];
    if (phases) {
      const double i_c = raw.i_c.empty() ? -(raw.i_a[k] + raw.i_b[k]) : raw.i_c[k];
      i[k] = clarke({raw.i_a[k], raw.i_b[k], i_c});
      sum_max = std::max(sum_max, std::abs(raw.i_a[k] + raw.i_b[k] + i_c));
      if (health.i_limit > 0) {
        const double level = health.i_limit * (1 - 1e-9) - 1e-6 * health.i_limit;
        clipped[k] = std::abs(raw.i_a[k]) >= level || std::abs(raw.i_b[k]) >= level ||
                     (sum_max > 1e-4 && std::abs(i_c) >= level);
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
  record.current_sensors = phases && sum_max < 1e-4 ? 2 : 3;
  const bool full_current = phases || stator || !raw.i_d.empty();

  // Onto the even grid.
  std::size_t missing = 0, stale_count = 0, clipped_count = 0;
  double jitter = 0;
  std::vector<std::size_t> kept;  // rows of the file that are new
  for (std::size_t k = 0; k < rows; ++k) {
    stale_count += stale[k] != 0;
    clipped_count += clipped[k] != 0;
    if (!stale[k]) kept.push_back(k);
  }
  const auto push = [&](double t, std::size_t a, std::size_t b, double share, bool ok) {
    record.t.push_back(t);
    record.theta_m.push_back(interpolate(raw.theta_m[a], raw.theta_m[b], share));
    record.i_alphabeta.push_back(i[a] + (i[b] - i[a]) * share);
    if (has_u) record.u_alphabeta.push_back(u[a] + (u[b] - u[a]) * share);
    if (!raw.v_dc.empty()) record.v_dc.push_back(interpolate(raw.v_dc[a], raw.v_dc[b], share));
    if (!raw.T_load.empty())
      record.T_load.push_back(interpolate(raw.T_load[a], raw.T_load[b], share));
    const bool unclipped = !clipped[a] && !clipped[b];
    record.electrical_ok.push_back(ok && unclipped);
    record.motion_ok.push_back(ok && unclipped);
  };
  for (std::size_t m = 0; m < kept.size(); ++m) {
    const std::size_t k = kept[m];
    if (m > 0) {
      const std::size_t before = kept[m - 1];
      const double span = raw.t[k] - raw.t[before];
      const auto steps = std::max<std::int64_t>(1, std::llround(span / record.T_s));
      const auto file_steps = static_cast<std::int64_t>(k - before);
      missing += static_cast<std::size_t>(std::max<std::int64_t>(0, steps - file_steps));
      jitter += std::pow(span / record.T_s - static_cast<double>(steps), 2);
      for (std::int64_t j = 1; j < steps; ++j) {
        const double share = static_cast<double>(j) / static_cast<double>(steps);
        push(raw.t[before] + share * span, before, k, share, steps <= 3);
      }
    }
    push(raw.t[k], k, k, 0, true);
  }
  if (!full_current || !has_u) record.u_alphabeta.clear();
  health.jitter = std::sqrt(jitter / static_cast<double>(std::max<std::size_t>(1, kept.size())));
  health.missing_share = static_cast<double>(missing) / static_cast<double>(rows + missing);
  health.stale_share = static_cast<double>(stale_count) / static_cast<double>(rows);
  health.clipped_share = static_cast<double>(clipped_count) / static_cast<double>(rows);
  return record;
}

}  // namespace twinrate
