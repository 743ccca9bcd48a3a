#include "identify/standstill.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "identify/admittance.hpp"

namespace twinrate {
namespace {

constexpr double kTurns = 2;  // of the voltage, one way
constexpr int kDirectLevels = 14;
constexpr double kBiases[] = {0.3, 0.5, 0.75, 1};  // of i_max, along d
constexpr double kBiasForQ = 0.75, kSineShare = 0.3;

// From i_k = a i_{k-1} + b u, the exact discretisation:  L = T_s (1 - a)/(-b ln a).
double inductance_of(const Rows& rows, double T_s) {
  double ii = 0, iu = 0, uu = 0, yi = 0, yu = 0;
  for (std::size_t k = 1; k < rows.size(); ++k) {
    const double i = rows[k - 1].i[0], u = rows[k].u[0], y = rows[k].i[0];
    ii += i * i, iu += i * u, uu += u * u, yi += y * i, yu += y * u;
  }
  const double det = ii * uu - iu * iu;
  const double a = std::clamp((yi * uu - yu * iu) / det, 0.02, 0.99999);
  const double b = (yu - a * iu) / uu;
  return T_s * (1 - a) / (-b * std::log(a));
}

// Inductance in H, from pulses of both signs, so that the rotor keeps its place.
double inductance_of_pulses(Experiment& e) {
  constexpr double kEnough = 0.3;  // of i_max
  double u = 1e-3 * e.u_max();
  for (int length = 2; length < e.ticks(0.2);) {
    Rows rows;
    e.record(&rows);
    for (const int sign : {1, -1, 0})
      for (int k = 0; k < (sign == 0 ? 10 : 1) * length; ++k) e.apply(Vec2(sign * u, 0));
    e.record(nullptr);
    double largest = 0;
    for (const Row& row : rows) largest = std::max(largest, std::abs(row.i[0]));
    if (largest > kEnough * e.i_max()) return inductance_of(rows, e.T_s());
    if (u < 0.4 * e.u_max())
      u *= 1.5;
    else
      length += std::max(1, length / 2);
  }
  throw RunFailed("no current follows the voltage: is the motor connected?");
}

struct Spread {
  double least = INFINITY, most = -INFINITY;
  void add(double x) { least = std::min(least, x), most = std::max(most, x); }
  double width() const { return most - least; }
};

// Holds a voltage until the encoder is quiet; the EMF of the swinging rotor damps it. Returns the
// mean angle of the last window.
double settle(Experiment& e, const Vec2& u) {
  constexpr double kWindow_s = 0.2, kLongest_s = 8;
  const double step = e.facts().encoder_counts > 0 ? kTwoPi / e.facts().encoder_counts : 0;
  const double quiet = std::max(2.5 * step, 5e-4);
  const int window = e.ticks(kWindow_s);
  for (double t = 0;; t += kWindow_s) {
    Spread angle;
    double mean = 0;
    for (int k = 0; k < window; ++k) {
      const double theta = e.apply(u).theta;
      angle.add(theta);
      mean += theta / window;
    }
    if (angle.width() < quiet || t > kLongest_s) return mean;
  }
}

Vec2 along(double phi) {
  return {std::cos(phi), std::sin(phi)};
}

// Raises a voltage along `phi` slowly until the current along it is `i`. A voltage instead of a
// current loop, because the EMF then damps the rotor. Returns the voltage.
double align(Experiment& e, double phi, double i) {
  constexpr double kFold_s = 0.4, kShare = 0.02, kWait_s = 0.3, kNear = 0.05;
  double u = 1e-3 * e.u_max(), smooth = 0;
  const auto tick = [&] {
    smooth += kShare * (e.apply(u * along(phi)).i.dot(along(phi)) - smooth);
  };
  while (smooth < 0.7 * i) {
    tick();
    u *= 1 + e.T_s() / kFold_s;
    if (u > 0.9 * e.u_max())
      throw RunFailed(fmt::format("{:.3g} A at full voltage: give a smaller test current", smooth));
  }
  for (int round = 0; round < 12; ++round) {
    for (int k = 0; k < e.ticks(kWait_s); ++k) tick();
    if (std::abs(smooth - i) < kNear * i) break;
    u *= std::clamp(i / smooth, 0.8, 1.1);
  }
  return u;
}

// Turns the voltage by `turns` from `phi`, slowly enough for the rotor: its EMF must change the
// current `i` only a little. Returns the mean angle at rest.
double turn(Experiment& e, double phi, double turns, double u, double i) {
  constexpr double kFastest = 8, kMost = 0.4, kShare = 0.02, kLongest_s = 120;  // rad/s, of i
  const double whole = kTwoPi * std::abs(turns), sign = turns < 0 ? -1 : 1;
  Vec2 smooth(i, 0);
  double angle = 0;
  for (int k = 0; angle < whole; ++k) {
    if (k > e.ticks(kLongest_s)) throw RunFailed("the shaft does not follow a slow current");
    const double at = phi + sign * angle;
    smooth += kShare * (park(e.apply(u * along(at)).i, at) - smooth);
    const double disturbed = (smooth - Vec2(i, 0)).norm() / (kMost * i);
    const double ends = std::min({1.0, 0.05 + angle, 0.05 + whole - angle});
    angle += e.T_s() * kFastest * ends * std::max(0.02, 1 - disturbed);
  }
  return settle(e, u * along(phi + kTwoPi * turns));
}

void find_wiring(Experiment& e, Identified& found) {
  const double i = e.i_max();
  // A rotor at the unstable equilibrium of one direction turns for the other direction.
  const double u = align(e, kPi / 2, i);
  const double start = turn(e, kPi / 2, -0.25, u, i);
  const double there = turn(e, 0, kTurns, u, i);
  const double back = turn(e, 0, -kTurns, u, i);
  const double turned = 0.5 * (there - start + there - back) / (kTwoPi * kTurns);
  if (std::abs(turned) < 1e-3)
    throw RunFailed(
        "the shaft does not follow a turning current: is it blocked, is the encoder connected?");
  const double ratio = 1 / std::abs(turned), sign = turned < 0 ? -1 : 1;
  found.n_p = static_cast<int>(std::lround(ratio));
  if (std::abs(ratio - found.n_p) > std::max(0.1, 0.02 * ratio))
    throw RunFailed(fmt::format(
        "{:.3g} electrical turns a turn of the shaft, not a whole number: the shaft slipped, or "
        "sensors.encoder_counts is wrong",
        ratio));
  found.mirrored = turned < 0;
  e.set_direction(found.mirrored ? -1 : 1);
  found.theta_zero = 0.5 * (sign * there - kTwoPi * kTurns / found.n_p + sign * back);
  e.begin_control(Vec2(u, 0));
}

struct Level {
  double i = 0, u = 0;
  double place = 0;  // in time: 0 for the first level, 1 for the last
  double moved = 0;  // rad, range of the shaft angle during the level
};

// The current loop finds the voltage of a level, which is then held constant: the swing of the
// rotor decays, and the voltage has no noise. The last level repeats the first to detect a winding
// that warms.
std::vector<Level> direct_levels(Experiment& e) {
  constexpr double kFind_s = 0.1, kSettle_s = 0.15, kMean_s = 0.2;
  // Below the lowest level the measured voltages show the form of the inverter's loss.
  constexpr double kSmall[] = {0.6, 0.35, 0.2, 0.1};
  std::vector<double> wanted;
  for (int level = kDirectLevels; level > 0; --level) wanted.push_back(level);
  for (const double level : kSmall) wanted.push_back(level);
  wanted.push_back(kDirectLevels);
  std::vector<Level> levels;
  for (std::size_t step = 0; step < wanted.size(); ++step) {
    const Vec2 i_ref(e.i_max() * wanted[step] / kDirectLevels, 0);
    for (int k = 0; k < e.ticks(kFind_s); ++k) e.control(i_ref, 0, 0);
    const Vec2 u(e.integral()[0], 0);
    for (int k = 0; k < e.ticks(kSettle_s); ++k) e.apply(u);
    Level mean{.place = static_cast<double>(step) / static_cast<double>(wanted.size() - 1)};
    const int ticks = e.ticks(kMean_s);
    Spread angle;
    for (int k = 0; k < ticks; ++k) {
      const Row& row = e.apply(u);
      angle.add(row.theta);
      mean.i += row.i[0] / ticks, mean.u += row.u[0] / ticks;
    }
    mean.moved = angle.width();
    levels.push_back(mean);
  }
  return levels;
}

struct DirectFit {
  Found R_s;         // at the first level
  double drift = 0;  // Ohm, from the first level to the last
  InverterLoss loss;
  double misfit = INFINITY;
};

// `i_sigma`: standard error of the offset that all levels share, A.
DirectFit fit_direct(const std::vector<Level>& levels, double i_sigma, double i_linear,
                     CurrentShape shape, bool drifts) {
  const auto n = static_cast<Eigen::Index>(levels.size());
  const bool lossy = i_linear > 0;
  const Eigen::Index of_loss = drifts ? 2 : 1;
  Eigen::MatrixXd A(n, of_loss + (lossy ? 1 : 0));
  Eigen::VectorXd u(n);
  for (Eigen::Index k = 0; k < n; ++k) {
    const Level& level = levels[static_cast<std::size_t>(k)];
    A(k, 0) = level.i;
    if (drifts) A(k, 1) = level.i * level.place;
    if (lossy)
      A(k, of_loss) =
          2.0 / 3 *
          (current_sign(level.i / i_linear, shape) + current_sign(level.i / (2 * i_linear), shape));
    u[k] = level.u;
  }
  const Eigen::MatrixXd N = (A.transpose() * A).inverse();
  const Eigen::VectorXd x = N * (A.transpose() * u);
  DirectFit fit;
  fit.misfit = (u - A * x).squaredNorm();
  const double variance = fit.misfit / static_cast<double>(n - A.cols() - (lossy ? 1 : 0));
  const double of_offset = (N * A.transpose() * Eigen::VectorXd::Ones(n))[0] * x[0] * i_sigma;
  fit.R_s = {x[0], std::hypot(std::sqrt(variance * N(0, 0)), of_offset)};
  if (drifts) fit.drift = x[1];
  if (lossy) fit.loss = {{x[of_loss], std::sqrt(variance * N(of_loss, of_loss))}, i_linear, shape};
  return fit;
}

// Searches the form of the smallest misfit, first coarsely, then finely.
DirectFit loss_form(const std::vector<Level>& levels, double i_max, bool drifts) {
  DirectFit best;
  const auto look = [&](double from, double to, double ratio) {
    for (int shape = 0; shape < 4; ++shape)
      for (double i_linear = from; i_linear < to; i_linear *= ratio) {
        const DirectFit fit =
            fit_direct(levels, 0, i_linear, static_cast<CurrentShape>(shape), drifts);
        if (fit.misfit < best.misfit) best = fit;
      }
  };
  look(2e-3 * i_max, 1.5 * i_max, 1.05);
  const double coarse = best.loss.i_linear;
  look(coarse / 1.06, coarse * 1.06, 1.004);
  return best;
}

// Slope u/i between half the test current and the full one, along `phi`.
double step_resistance(Experiment& e, double phi) {
  constexpr double kFind_s = 0.1, kSettle_s = 0.15, kMean_s = 0.2;
  double i[2] = {}, u[2] = {};
  for (const int half : {0, 1}) {
    const Vec2 i_ref(e.i_max() * (half == 1 ? 0.5 : 1), 0);
    for (int k = 0; k < e.ticks(kFind_s); ++k) e.control(i_ref, phi, 0);
    const Vec2 held = e.integral()[0] * along(phi);
    for (int k = 0; k < e.ticks(kSettle_s); ++k) e.apply(held);
    const int ticks = e.ticks(kMean_s);
    for (int k = 0; k < ticks; ++k) {
      const Row& row = e.apply(held);
      i[half] += row.i.dot(along(phi)) / ticks, u[half] += row.u.dot(along(phi)) / ticks;
    }
  }
  return (u[0] - u[1]) / (i[0] - i[1]);
}

// Aligns the rotor with each phase in turn. If the phases differ, R_s is the mean.
void compare_phases(Experiment& e, Identified& found) {
  constexpr double kMaterial = 5e-3;
  const double u = found.R_s.value * e.i_max() + 4.0 / 3 * found.loss.V.value;
  double R[3] = {step_resistance(e, 0), 0, 0};
  for (const int phase : {1, 2}) {
    turn(e, kTwoPi / 3 * (phase - 1), 1.0 / 3, u, e.i_max());
    e.begin_control(Vec2(u, 0));
    R[phase] = step_resistance(e, kTwoPi / 3 * phase);
  }
  turn(e, 2 * kTwoPi / 3, -2.0 / 3, u, e.i_max());
  const double mean = (R[0] + R[1] + R[2]) / 3;
  const double spread = std::max({R[0], R[1], R[2]}) - std::min({R[0], R[1], R[2]});
  if (found.R_s_drifts || spread < kMaterial * mean) return;
  for (const double R_phase : R)
    found.phase_spread = std::max(found.phase_spread, std::abs(R_phase / mean - 1));
  found.R_s.value *= mean / R[0];
  found.notes.push_back(fmt::format(
      "phases: along a, b, c the resistance is {:+.2g}, {:+.2g}, {:+.2g} % off its mean, which R_s "
      "is: a joint, a cable or the gain of a current sensor; by such a gain L_d and L_q are wrong "
      "by up to twice that",
      100 * (R[0] / mean - 1), 100 * (R[1] / mean - 1), 100 * (R[2] / mean - 1)));
}

// Removes the small levels if the shaft moved: a small current does not hold it against unbalance
// or cogging, and its EMF is no loss of the inverter.
void erase_levels_that_slip(const Experiment& e, std::vector<Level>& levels) {
  const double count = e.facts().encoder_counts > 0 ? kTwoPi / e.facts().encoder_counts : 0;
  bool slips = false;
  for (std::size_t k = kDirectLevels; k + 1 < levels.size(); ++k)
    slips |= levels[k].moved > std::max(2.5 * count, 5e-4);
  if (slips) levels.erase(levels.begin() + kDirectLevels, levels.end() - 1);
}

// The form of the loss is fitted to all levels. R_s and the size of the loss are fitted to the
// levels above its linear zone, in which a small error of the current causes a large one of the
// voltage.
DirectFit best_direct_fit(const Experiment& e, const std::vector<Level>& levels, bool drifts) {
  constexpr double kMaterial = 2e-3, kSigmas = 4, kAsGood = 1.5;
  const double i_sigma = e.offset_sigma_alpha();
  const DirectFit form = loss_form(levels, e.i_max(), drifts);
  std::vector<Level> large = levels;
  std::erase_if(large, [&](const Level& l) { return l.i < 0.8 / kDirectLevels * e.i_max(); });
  const DirectFit plain = fit_direct(large, i_sigma, 0, CurrentShape::kClamp, drifts);
  DirectFit best = fit_direct(large, i_sigma, form.loss.i_linear, form.loss.shape, drifts);
  // The error of R_s includes its difference in other forms that fit about as well.
  for (int shape = 0; shape < 4; ++shape)
    for (double i_linear = 2e-3 * e.i_max(); i_linear < 1.5 * e.i_max(); i_linear *= 1.05) {
      const auto form_of = static_cast<CurrentShape>(shape);
      if (fit_direct(levels, i_sigma, i_linear, form_of, drifts).misfit > kAsGood * form.misfit)
        continue;
      const DirectFit other = fit_direct(large, i_sigma, i_linear, form_of, drifts);
      best.R_s.sigma = std::max(best.R_s.sigma, 0.5 * std::abs(other.R_s.value - best.R_s.value));
    }
  const double u = plain.R_s.value * e.i_max();
  const Found V = best.loss.V;
  const bool negligible =
      std::abs(V.value) < kMaterial * u || std::abs(V.value) < kSigmas * V.sigma;
  return negligible ? plain : best;
}

void find_resistance(Experiment& e, Identified& found) {
  constexpr double kDrift = 3e-3;
  std::vector<Level> levels = direct_levels(e);
  e.pause();
  erase_levels_that_slip(e, levels);
  const double again = levels.back().u / levels.back().i * levels.front().i / levels.front().u;
  found.R_s_drifts = std::abs(again - 1) > kDrift;
  const DirectFit best = best_direct_fit(e, levels, found.R_s_drifts);
  found.R_s = best.R_s;
  found.loss = best.loss;
  if (found.R_s_drifts)
    found.notes.push_back(
        fmt::format("R_s: changed by {:+.2g} % while the direct currents were on (a winding that "
                    "warms?); R_s is that of their beginning",
                    100 * best.drift / best.R_s.value));
  if (found.loss.V.value != 0 && found.loss.i_linear > 0.5 * e.i_max())
    found.notes.push_back(
        "loss of the inverter: it has not reached its full value at the test current, so a part of "
        "it can be in R_s; a larger test current separates them");
}

// The voltage that holds `i` along alpha.
Vec2 holding(const Identified& found, double i) {
  return found.R_s.value * Vec2(i, 0) + found.loss.drop(Vec2(i, 0));
}

// Relative error of L_q from the mean friction and the mean swing in the model of the q axis.
constexpr double kModelOfSwing = 5e-4;

void find_inductances(Experiment& e, Identified& found, double L_pulse) {
  double L = L_pulse;
  for (const double bias : kBiases) {
    const double i = bias * e.i_max();
    settle(e, holding(found, i));
    const std::vector<Sine> sines = sweep(
        e, {holding(found, i), Vec2(1, 0), kSineShare * i, found.R_s.value, L}, {6, 12, 24, 48});
    e.pause();
    const double R = found.R_s.value;
    if (found.L_d_points.empty()) found.current = find_lateness(sines, e.T_s(), R);
    const AxisFit fit = fit_axis(sines, e.T_s(), R, false, found.current);
    L = fit.L.value;
    found.L_d_points.push_back({i, fit.L, true});
  }
  const InductanceFit d = fit_inductance(found.L_d_points);
  found.L_d = d.L;
  found.saturation_d = d.saturation;
  const double i = kBiasForQ * e.i_max();
  settle(e, holding(found, i));
  const std::vector<Sine> sines =
      sweep(e, {holding(found, i), Vec2(0, 1), kSineShare * i, found.R_s.value, L},
            {6, 8, 12, 16, 24, 32, 48, 64});
  e.pause();
  const AxisFit q = fit_axis(sines, e.T_s(), found.R_s.value, true, found.current);
  found.L_q = q.L;
  found.L_q.sigma = std::hypot(found.L_q.sigma, kModelOfSwing * found.L_q.value);
  // For a sine of amplitude A about zero, L_q is flux over current at about 0.85 A: at 8/(3 pi) A
  // if the flux falls with i |i|, at sqrt(3)/2 A if it falls with i^3.
  found.L_q_points = {{0.85 * q.i, found.L_q, false}};
}

}  // namespace

void identify_standstill(Experiment& e, Identified& found) {
  e.show("offsets of the current sensors, pulses", 0);
  e.measure_offsets(e.ticks(0.2));
  found.i_offset = e.offsets();
  const double L_pulse = inductance_of_pulses(e);
  e.set_inductance(L_pulse);
  e.show("phase order, encoder, pole pairs", 0.05);
  find_wiring(e, found);
  e.show("direct currents", 0.3);
  find_resistance(e, found);
  compare_phases(e, found);
  e.show("inductances", 0.4);
  find_inductances(e, found, L_pulse);
  e.set_inductance(std::min(found.L_d.value, found.L_q.value));
}

}  // namespace twinrate
