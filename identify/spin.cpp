#include "identify/spin.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "identify/segmented_fit.hpp"

namespace twinrate {
namespace {

constexpr double kLevels[] = {0.25, 0.5, 0.75, 1};  // of i_max
constexpr int kLevelCount = 4;
constexpr Eigen::Index kLag = 2 + kLevelCount;  // column of FluxFit
constexpr int kHarmonics = 4;                   // columns behind it
constexpr double kVoltageShare = 0.6;           // of u_max: where the first run-up ends
constexpr double kCoastSpeeds[] = {1, 0.45, 0.2};
constexpr std::size_t kLeastRows = 60;  // of a piece

// What the samples at its ends do not show of a tick.
struct Tick {
  Vec2 bow = Vec2::Zero();   // A, mean current less that of the chord
  double bow_q = 0;          // A, mean i_q less the mean of its two ends
  Vec2 drop = Vec2::Zero();  // V, mean loss of the inverter
};

struct SpinRun {
  Rows rows;
  std::vector<Tick> ticks = {};  // of the tick before each row; empty as long as psi_f is unknown
  int level = -1;                // of kLevels; -1: coast, slow ramp
};

class Spinner {
 public:
  Spinner(Experiment& e, const Identified& found) : e_(e), found_(found) {
    e_.begin_control(Vec2::Zero());
    before_ = theta_e();
  }
  double omega_e() const { return omega_e_; }
  double u() const { return u_; }  // V, amplitude, smoothed like the speed

  void tick(double i_q) {
    // A quantised angle: its difference is smoothed over some fifty ticks. A reversal takes forty: at
    // 0.2 rad a tick the loop overshoots a step of twice the test current by more than half of it.
    constexpr double kShare = 0.02, kSlew = 0.05;
    i_ref_ += std::clamp(i_q - i_ref_, -kSlew * e_.i_max(), kSlew * e_.i_max());
    const Row& row = e_.control(Vec2(0, i_ref_), before_, omega_e_);
    const double now = found_.n_p * (row.theta - found_.theta_zero);
    omega_e_ += kShare * ((now - before_) / e_.T_s() - omega_e_);
    u_ += kShare * (row.u.norm() - u_);
    before_ = now;
  }
  // Until `done()`; false where the time is over first.
  template <class Done>
  bool run(double i_q, double longest_s, Done done) {
    for (int k = 0; k < e_.ticks(longest_s); ++k) {
      tick(i_q);
      if (done()) return true;
    }
    return false;
  }
  // Accelerates or brakes to an electrical speed.
  bool go_to(double omega_e, double i, double longest_s) {
    const bool up = omega_e > omega_e_;
    return run(up ? i : -i, longest_s,
               [&] { return up ? omega_e_ >= omega_e : omega_e_ <= omega_e; });
  }

 private:
  double theta_e() const { return found_.n_p * (e_.now().theta - found_.theta_zero); }

  Experiment& e_;
  const Identified& found_;
  double before_ = 0, omega_e_ = 0, u_ = 0, i_ref_ = 0;
};

// A voltage that acts m ticks late has turned by m omega_e T_s less than the EMF has: meanwhile the
// current runs away by about
//   |u| omega_e (m T_s)^2/(2 L)
bool lateness_limits(const Experiment& e, const Spinner& spinner) {
  constexpr double kMost = 0.6;  // of i_max; at twice i_max the experiment ends
  const double late = (e.late_ticks() + (e.late_ticks() > 0 ? 1 : 0)) * e.T_s();
  return spinner.u() * std::abs(spinner.omega_e()) * late * late / (2 * e.inductance()) >
         kMost * e.i_max();
}

// The top of the speed range, electrical.
double run_up(Experiment& e, Spinner& spinner, const Identified& found) {
  constexpr double kPatience_s = 15, kRelease_s = 0.1;
  const double limit = e.omega_m_max() > 0 ? found.n_p * e.omega_m_max() : INFINITY;
  const auto at_the_top = [&] {
    return spinner.u() > kVoltageShare * e.u_max() || spinner.omega_e() > 0.95 * limit ||
           lateness_limits(e, spinner);
  };
  spinner.run(0, kRelease_s, [] { return false; });  // of the current that held the rotor
  for (const double share : {0.3, 1.0})
    if (spinner.run(share * e.i_max(), kPatience_s, at_the_top)) return spinner.omega_e();
  if (spinner.omega_e() * e.T_s() < 1e-3)
    throw RunFailed(fmt::format("the shaft does not turn at {:.3g} A", e.i_max()));
  return spinner.omega_e();
}

// In a small range of speed the ramps are too short for J and friction: ramps of some 600 rows, or of
// as little current as still accelerates.
void slow_ramps(Experiment& e, Spinner& spinner, double top, std::vector<SpinRun>& segments) {
  constexpr double kRows = 600, kLongest_s = 3, kLeast = 0.1;  // of the smallest level
  double rows = kRows;
  for (const SpinRun& s : segments)
    if (s.level == 0) rows = std::min(rows, static_cast<double>(s.rows.size()));
  const double i = kLevels[0] * e.i_max() * std::max(kLeast, rows / kRows);
  for (int repeat = 0; repeat < 3; ++repeat)
    for (const int sign : {-1, 1}) {
      SpinRun s;
      e.record(&s.rows);
      const bool there = spinner.go_to(sign * top, i, kLongest_s);
      e.record(nullptr);
      if (!there) spinner.go_to(sign * top, e.i_max(), kLongest_s);
      segments.push_back(std::move(s));
    }
}

std::vector<SpinRun> spin(Experiment& e, Identified& found) {
  constexpr double kLongest_s = 12, kCoast_s = 6, kEnough_s = 20;
  std::vector<SpinRun> segments;
  Spinner spinner(e, found);
  const double top = run_up(e, spinner, found);
  found.omega_m_max = top / found.n_p;
  const bool lateness_limited = lateness_limits(e, spinner);
  if (lateness_limited)
    found.notes.push_back(
        fmt::format("link: voltages acted up to {} ticks late, so the speed ended at {:.4g} rpm: "
                    "the figures of "
                    "the turning motor are less exact than they could be",
                    e.late_ticks(), found.omega_m_max * 60 / kTwoPi));
  const double begin = e.seconds();
  for (int repeat = 0; repeat < 3; ++repeat) {
    if (repeat == 2 && e.seconds() - begin > kEnough_s) break;
    for (int level = 0; level < kLevelCount; ++level) {
      for (const int sign : {-1, 1}) {
        SpinRun s{.rows = {}, .level = level};
        e.record(&s.rows);
        const bool there = spinner.go_to(sign * top, kLevels[level] * e.i_max(), kLongest_s);
        e.record(nullptr);
        if (!there) spinner.go_to(sign * top, e.i_max(), kLongest_s);
        segments.push_back(std::move(s));
      }
    }
    e.show("spin", 0.6 + 0.08 * repeat);
  }
  if (lateness_limited) slow_ramps(e, spinner, top, segments);
  for (const double share : kCoastSpeeds) {
    for (const int sign : {1, -1}) {
      spinner.go_to(sign * share * top, 0.5 * e.i_max(), kLongest_s);
      spinner.run(0, 2e-3, [] { return false; });
      SpinRun s;
      e.record(&s.rows);
      spinner.run(0, kCoast_s, [&] { return sign * spinner.omega_e() < 0.4 * share * top; });
      e.record(nullptr);
      segments.push_back(std::move(s));
    }
    e.show("coast", 0.85);
  }
  spinner.go_to(0, 0.5 * e.i_max(), kLongest_s);
  return segments;
}

// d theta/dt about row k.
double speed_about(const Rows& rows, std::size_t k, double T_s) {
  constexpr std::size_t kWindow = 8;
  const std::size_t a = k > kWindow ? k - kWindow : 0, b = std::min(rows.size() - 1, k + kWindow);
  return (rows[b].theta - rows[a].theta) / (static_cast<double>(b - a) * T_s);
}

// A row that repeats the one before lies between its neighbours; an angle that stood still in it,
// too. The currents turn.
void mend_stale_rows(Rows& rows, int n_p) {
  for (std::size_t k = 1; k + 1 < rows.size(); ++k) {
    if (!rows[k].repeats || rows[k + 1].repeats) continue;
    Row &row = rows[k], &before = rows[k - 1], &after = rows[k + 1];
    const double half = 0.5 * n_p * (after.theta - before.theta);
    row.i = 0.5 * (inverse_park(before.i, half) + park(after.i, half));
    if (row.theta == before.theta) row.theta = 0.5 * (before.theta + after.theta);
  }
}

// Currents into the time of the voltage.
void turn_currents(Rows& rows, double angle_per_speed, double T_s) {
  if (rows.size() < 2) return;
  for (std::size_t k = 0; k < rows.size(); ++k)
    rows[k].i = inverse_park(rows[k].i, angle_per_speed * speed_about(rows, k, T_s));
}

// The voltage stands still while the EMF turns, and near zero current the loss of the inverter is a
// large resistance: the tick is integrated, in rotor axes,
//   L_d i_d' = u_d - R_s i_d - drop_d + omega L_q i_q
//   L_q i_q' = u_q - R_s i_q - drop_q - omega (L_d i_d + psi_f)
Tick inside_tick(const Identified& f, const Row& before, const Row& row, double T_s) {
  constexpr double kFar = 4;  // of i_linear
  const double from = f.n_p * (before.theta - f.theta_zero);
  const double omega = f.n_p * (row.theta - before.theta) / T_s;
  const double L_d = f.L_d.value, L_q = f.L_q.value, R = f.R_s.value;
  const bool is_far = f.loss.V.value == 0 ||
                      inverse_clarke(before.i).cwiseAbs().minCoeff() > kFar * f.loss.i_linear;
  const double stiffness =
      T_s * (R + (is_far ? 0 : f.loss.V.value / f.loss.i_linear)) / std::min(L_d, L_q);
  const int n = std::clamp(static_cast<int>(4 * stiffness), 6, 60);
  const double dt = T_s / n;
  Vec2 d(std::cos(from), std::sin(from));  // the d axis
  const Vec2 half(std::cos(0.5 * omega * dt), std::sin(0.5 * omega * dt));
  const auto turn = [&](const Vec2& x) {
    return Vec2(x[0] * half[0] - x[1] * half[1], x[0] * half[1] + x[1] * half[0]);
  };
  const auto in_stator = [](const Vec2& i_dq, const Vec2& axis) {
    return Vec2(i_dq[0] * axis[0] - i_dq[1] * axis[1], i_dq[0] * axis[1] + i_dq[1] * axis[0]);
  };
  const auto slope = [&](const Vec2& i_dq, const Vec2& axis) {
    const Vec2 u = row.u - f.loss.drop(in_stator(i_dq, axis));
    const double u_d = u.dot(axis), u_q = u[1] * axis[0] - u[0] * axis[1];
    return Vec2((u_d - R * i_dq[0] + omega * L_q * i_dq[1]) / L_d,
                (u_q - R * i_dq[1] - omega * (L_d * i_dq[0] + f.psi_f.value)) / L_q);
  };
  const Vec2 begin = park(before.i, from);
  Vec2 i = begin, sum = Vec2::Zero(), drops = Vec2::Zero();
  double sum_q = 0;
  for (int k = 0; k < n; ++k) {
    const Vec2 middle = i + 0.5 * dt * slope(i, d);
    d = turn(d);
    const Vec2 at = in_stator(middle, d);
    sum += at / n, sum_q += middle[1] / n, drops += f.loss.drop(at) / n;
    i += dt * slope(middle, d);
    d = turn(d);
  }
  return {sum - 0.5 * (before.i + in_stator(i, d)), sum_q - 0.5 * (begin[1] + i[1]), drops};
}

std::vector<Tick> inside_ticks(const Identified& f, const Rows& rows, double T_s) {
  std::vector<Tick> ticks(rows.size());
  for (std::size_t k = 1; k < rows.size(); ++k) {
    Row at = rows[k], before = rows[k - 1];
    const double step = 0.5 * T_s * speed_about(rows, k, T_s),
                 mean = 0.5 * (at.theta + before.theta);
    before.theta = mean - step, at.theta = mean + step;  // no steps of the encoder
    ticks[k] = inside_tick(f, before, at, T_s);
  }
  return ticks;
}

void advance_angles(Rows& rows, double lag, double T_s) {
  if (rows.size() < 2) return;
  std::vector<double> speeds;
  for (std::size_t k = 0; k < rows.size(); ++k) speeds.push_back(speed_about(rows, k, T_s));
  for (std::size_t k = 0; k < rows.size(); ++k) rows[k].theta += lag * speeds[k];
}

// Columns: psi_d, psi_x, L_q of each level, psi_f times the lag of the angle, harmonics of the flux in
// rotor axes: d and q, cos and sin of six times the electrical angle.
class FluxFit {
 public:
  FluxFit(const Experiment& e, const Identified& found)
      : fit_(3 + kLevelCount + kHarmonics), found_(found), T_s_(e.T_s()) {}

  void add(const SpinRun& segment) {
    constexpr std::size_t kPiece = 4000;
    const Rows& rows = segment.rows;
    for (std::size_t begin = 0; begin + kLeastRows < rows.size(); begin += kPiece)
      add_piece(segment, begin, std::min(begin + kPiece, rows.size()));
  }
  SegmentedFit::Solution solve(const std::vector<Eigen::Index>& used) const {
    return fit_.solve(used);
  }

 private:
  double theta_e(const Row& row) const { return found_.n_p * (row.theta - found_.theta_zero); }

  void add_piece(const SpinRun& segment, std::size_t begin, std::size_t end) {
    const Rows& rows = segment.rows;
    const int level = segment.level;
    const auto n = static_cast<Eigen::Index>(end - begin);
    Eigen::MatrixXd local = Eigen::MatrixXd::Zero(2 * n, 4);
    Eigen::MatrixXd shared = Eigen::MatrixXd::Zero(2 * n, kLag + 1 + kHarmonics);
    Eigen::VectorXd y(2 * n);
    Vec2 psi = Vec2::Zero();
    for (Eigen::Index k = 0; k < n; ++k) {
      const Row& row = rows[begin + static_cast<std::size_t>(k)];
      const double theta = theta_e(row);
      if (k > 0) {
        const Row& before = rows[begin + static_cast<std::size_t>(k) - 1];
        // The mean of a vector that turns by 2x between its ends.
        const double x = 0.5 * (theta - theta_e(before));
        const double bend = std::abs(x) < 1e-6 ? 1 : std::tan(x) / x;
        Vec2 i = 0.5 * bend * (row.i + before.i), drop = found_.loss.drop(i);
        if (!segment.ticks.empty()) {
          const Tick& tick = segment.ticks[begin + static_cast<std::size_t>(k)];
          i += tick.bow, drop = tick.drop;
        }
        psi += T_s_ * (row.u - drop - found_.R_s.value * i);
      }
      const double omega_e =
          found_.n_p * speed_about(rows, begin + static_cast<std::size_t>(k), T_s_);
      const Vec2 i_dq = park(row.i, theta);
      const Vec2 known = inverse_park(Vec2(found_.L_d.value * i_dq[0], 0), theta);
      for (int axis = 0; axis < 2; ++axis) {
        const Eigen::Index r = 2 * k + axis;
        y[r] = psi[axis] - known[axis];
        local(r, axis) = 1;
        local(r, 2 + axis) = static_cast<double>(k) / static_cast<double>(n);
        shared(r, 0) = inverse_park(Vec2(1, 0), theta)[axis];
        shared(r, 1) = inverse_park(Vec2(0, 1), theta)[axis];
        shared(r, kLag) = omega_e * shared(r, 1);
        for (int column = 0; column < kHarmonics; ++column)
          shared(r, kLag + 1 + column) =
              shared(r, column / 2) * (column % 2 == 0 ? std::cos(6 * theta) : std::sin(6 * theta));
        const double along_q = inverse_park(Vec2(0, i_dq[1]), theta)[axis];
        if (level >= 0)
          shared(r, 2 + level) = along_q;
        else
          y[r] -= found_.L_q.value * along_q;
      }
    }
    fit_.add(local, shared, y);
  }

  SegmentedFit fit_;
  const Identified& found_;
  double T_s_;
};

// A falling L_q is a saturation. One that is larger beside no current along d is none; a resistance
// that is not the R_s at rest makes one.
void note_rising_inductance(Identified& found) {
  constexpr double kSigmas = 3, kMaterial = 0.02;
  const Found& rest = found.L_q_points.front().L;
  if (found.R_s_drifts) return;
  for (const InductancePoint& p : found.L_q_points) {
    const double rise = p.L.value - rest.value;
    if (rise < kMaterial * rest.value || rise < kSigmas * std::hypot(p.L.sigma, rest.sigma))
      continue;
    found.notes.push_back(fmt::format(
        "L_q: {:.3g} mH at rest beside the holding current, {:.3g} mH turning without it, as with "
        "cross saturation, another R_s or loss of the inverter; the file has the first",
        1e3 * rest.value, 1e3 * p.L.value));
    return;
  }
}

// Their EMF drives currents that brake, and a torque that the motion's model lacks.
void note_flux_harmonics(const FluxFit& flux, std::vector<Eigen::Index> used, Identified& found) {
  constexpr double kSigmas = 5, kMaterial = 5e-3;  // of psi_f
  // Three per cent made B 70 % too large (docs/identify-a-motor.md).
  constexpr double kFrictionAShare = 30;
  for (int column = 0; column < kHarmonics; ++column) used.push_back(kLag + 1 + column);
  const auto s = flux.solve(used);
  const double share = s.x.tail<kHarmonics>().norm() / found.psi_f.value;
  const double sigma = s.sigma.tail<kHarmonics>().norm() / found.psi_f.value;
  if (share < kMaterial || share < kSigmas * sigma) return;
  found.flux_harmonics = share;
  found.friction_share = std::min(1.0, kFrictionAShare * share);
  found.notes.push_back(fmt::format(
      "friction may be shifted: the flux linkage has harmonics, {:.2g} % of psi_f at order {} a "
      "turn; their currents brake, and B_Nms and the Coulomb torque take that for friction",
      100 * share, 6 * found.n_p));
}

void find_flux(const Experiment& e, std::vector<SpinRun>& segments, Identified& found) {
  // What errors of R_s and of the angle's zero leave in a flux, of psi_f: in L_q at its current,
  // and in psi_f. The loss of the inverter leaves a share of its voltage over the EMF. Of 35
  // drawn drives, whose errors were up to 12 sigmas of the jackknife alone.
  constexpr double kFluxError = 1e-3, kErrorOfPsi = 5e-5, kErrorOfLoss = 0.04;
  constexpr double kSigmas = 5, kLagMaterial = 0.03;  // of a tick
  // The second pass has the corrected zero of the angle, the third and fourth its lag.
  bool is_late = false;
  for (int pass = 0; pass < (is_late ? 4 : 2); ++pass) {
    FluxFit flux(e, found);
    std::vector<Eigen::Index> used = {0, 1};
    for (const SpinRun& s : segments) {
      flux.add(s);
      const Eigen::Index column = 2 + s.level;
      if (s.level >= 0 && s.rows.size() > kLeastRows &&
          std::count(used.begin(), used.end(), column) == 0)
        used.push_back(column);
    }
    if (is_late || pass == 1) {
      std::vector<Eigen::Index> with = used;
      with.push_back(kLag);
      const auto s = flux.solve(with);
      const double psi = std::hypot(s.x[0], s.x[1]);
      const Found lag{s.x[kLag] / psi, s.sigma[kLag] / psi};
      if (pass == 1)
        is_late = std::abs(lag.value) > kSigmas * lag.sigma &&
                  std::abs(lag.value) > kLagMaterial * e.T_s();
      if (is_late) {
        used = with;
        found.angle_lag = {found.angle_lag.value + lag.value, lag.sigma};
        for (SpinRun& run : segments) advance_angles(run.rows, lag.value, e.T_s());
      }
    }
    const auto solution = flux.solve(used);
    const auto &x = solution.x, &sigma = solution.sigma;
    const double psi = std::hypot(x[0], x[1]);
    const double of_loss = kErrorOfLoss * std::abs(found.loss.V.value) /
                           (found.n_p * std::max(found.omega_m_max, 1e-9));
    found.psi_f = {psi, std::hypot(sigma[0], kErrorOfPsi * psi, of_loss)};
    found.theta_zero += std::atan2(x[1], x[0]) / found.n_p;
    if (pass == 0 || is_late)
      for (SpinRun& s : segments) s.ticks = inside_ticks(found, s.rows, e.T_s());
    found.L_q_points.resize(1);  // of standstill
    for (const Eigen::Index column : used) {
      if (column < 2 || column == kLag) continue;
      const double i = kLevels[column - 2] * e.i_max();
      const double error = std::hypot(sigma[column], kFluxError * found.psi_f.value / i);
      found.L_q_points.push_back({i, {x[column], error}, false});
    }
    if (pass + 1 == (is_late ? 4 : 2)) note_flux_harmonics(flux, used, found);
  }
}

// Columns: 1/J, B/J, T_C/J, T_0/J, a torque with the square of the speed, and one of a period a
// turn (sin, cos).
class MotionFit {
 public:
  MotionFit(const Experiment& e, const Identified& found) : fit_(7), found_(found), T_s_(e.T_s()) {}

  void add(const SpinRun& segment) {
    const Rows& rows = segment.rows;
    constexpr int kWindow = 8;
    const auto n = static_cast<int>(rows.size());
    if (n < 6 * kWindow) return;
    const int stride = std::max(1, n / 3000);
    const Eigen::Index m = (n - 1) / stride + 1;
    Eigen::MatrixXd local(m, 2), shared(m, 7);
    Eigen::VectorXd y(m);
    using Terms = Eigen::Matrix<double, 7, 1>;
    Terms once = Terms::Zero(), twice = Terms::Zero(), before = Terms::Zero();
    const auto theta = [&](int k) { return rows[static_cast<std::size_t>(k)].theta; };
    for (int k = 0; k < n; ++k) {
      const int a = std::max(0, k - kWindow), b = std::min(n - 1, k + kWindow);
      const double omega = (theta(b) - theta(a)) / ((b - a) * T_s_);
      const double sign = omega > 0 ? 1 : omega < 0 ? -1 : 0;
      Terms now;
      now << torque(rows[static_cast<std::size_t>(k)]), 0, -sign, -1, -omega * std::abs(omega),
          -std::sin(theta(k)), -std::cos(theta(k));
      if (k > 0) {
        Terms next = once + 0.5 * T_s_ * (before + now);
        next[0] += T_s_ * 1.5 * found_.n_p * found_.psi_f.value *
                   segment.ticks[static_cast<std::size_t>(k)].bow_q;
        twice += 0.5 * T_s_ * (once + next);
        once = next;
        twice[1] -= 0.5 * T_s_ * (theta(k) + theta(k - 1) - 2 * theta(0));
      }
      before = now;
      if (k % stride != 0) continue;
      const Eigen::Index r = k / stride;
      local.row(r) << 1, static_cast<double>(k) / n;
      shared.row(r) = twice.transpose();
      y[r] = theta(k);
    }
    fit_.add(local, shared, y);
  }
  SegmentedFit::Solution solve(const std::vector<Eigen::Index>& used) const {
    return fit_.solve(used);
  }

 private:
  double torque(const Row& row) const {
    const Vec2 i = park(row.i, found_.n_p * (row.theta - found_.theta_zero));
    const double psi_d = found_.psi_f.value + found_.L_d.value * i[0];
    return 1.5 * found_.n_p * (psi_d * i[1] - found_.L_q.value * i[1] * i[0]);
  }

  SegmentedFit fit_;
  const Identified& found_;
  double T_s_;
};

void find_motion(const Experiment& e, const std::vector<SpinRun>& segments, Identified& found) {
  constexpr double kSigmas = 4, kShare = 0.02, kFanShare = 0.2;
  // What quadrature and quantised angle leave in J and in the friction, of the same drives.
  constexpr double kErrorOfJ = 2e-4, kErrorOfFriction = 4e-3;
  // Of the test torque: currents that the loss of the inverter hides within a tick.
  constexpr double kErrorOfLoss = 5e-5;
  MotionFit motion(e, found);
  for (const SpinRun& s : segments) motion.add(s);
  std::vector<Eigen::Index> used = {0, 1, 2, 3};
  auto solution = motion.solve(used);
  const auto material = [&](Eigen::Index term) {
    const double omega = found.omega_m_max;
    const double size = std::abs(solution.x[term]) * (term == 1 ? omega : 1);
    const double all = std::abs(solution.x[1]) * omega + std::abs(solution.x[2]);
    return std::abs(solution.x[term]) > kSigmas * solution.sigma[term] && size > kShare * all;
  };
  // A torque with the square of the speed is tried first: without it the others take its part.
  used.push_back(4);
  const auto fan = motion.solve(used);
  const double omega = found.omega_m_max;
  const double square = fan.x[4] * omega * omega, other = fan.x[1] * omega + fan.x[2];
  const bool has_fan =
      fan.x[4] > kSigmas * fan.sigma[4] && square > kFanShare * (square + std::abs(other));
  if (has_fan)
    solution = fan;
  else
    used.pop_back();
  double assisting = 0;  // Nm over J
  for (const Eigen::Index term : {3, 2}) {
    const bool assists = term == 2 && solution.x[2] < 0;  // no friction does
    if (material(term) && !assists) continue;
    if (assists && material(term)) assisting = solution.x[2];
    std::erase(used, term);
    solution = motion.solve(used);
  }
  // Once a turn: unbalance, or an encoder that is not centred.
  std::vector<Eigen::Index> unbalanced = used;
  unbalanced.insert(unbalanced.end(), {5, 6});
  const auto once = motion.solve(unbalanced);
  const double swing = std::hypot(once.x[5], once.x[6]);
  // A small one drowns in its own jackknife, but not in the residual.
  constexpr double kFalls = 0.9;
  const bool is_seen = swing > kSigmas * std::hypot(once.sigma[5], once.sigma[6]) ||
                       once.rms < kFalls * solution.rms;
  if (is_seen && swing > kShare * (std::abs(once.x[1]) * omega + std::abs(once.x[2])))
    solution = once;
  const double J = 1 / solution.x[0];
  const double J_share = std::hypot(solution.sigma[0] / solution.x[0], kErrorOfJ);
  if (assisting < 0)
    found.notes.push_back(
        fmt::format("Coulomb friction: {:.2g} Nm fits best, a torque that drives; left out, B_Nms "
                    "is that of a fit without it",
                    assisting * J));
  const auto scaled = [&](Eigen::Index term) {
    return Found{solution.x[term] * J,
                 std::hypot(solution.sigma[term] * J, solution.x[term] * J * J_share,
                            solution.x[term] * J * kErrorOfFriction)};
  };
  const double hidden = found.loss.V.value == 0
                            ? 0
                            : kErrorOfLoss * 1.5 * found.n_p * found.psi_f.value * found.i_max;
  found.J = {J, J * std::hypot(J_share, found.psi_f.sigma / found.psi_f.value)};
  found.B = scaled(1);
  found.B.sigma = std::hypot(found.B.sigma, hidden / omega);
  found.T_coulomb = scaled(2);
  found.T_constant = scaled(3);
  for (Found* friction : {&found.B, &found.T_coulomb})
    friction->sigma = std::hypot(friction->sigma, found.friction_share * friction->value);
  found.fan = scaled(4);
  found.T_sin = scaled(5), found.T_cos = scaled(6);
  if (found.B.value < kSigmas * found.B.sigma) {
    found.notes.push_back(fmt::format("viscous friction: {:.2g} Nms is not above {:g} sigmas",
                                      found.B.value, kSigmas));
    found.B.value = std::max(0.0, found.B.value);
  }
}

}  // namespace

void identify_spin(Experiment& e, Identified& found) {
  e.show("run-up", 0.55);
  std::vector<SpinRun> segments = spin(e, found);
  e.pause();
  found.stale_share = e.stale_share();
  for (SpinRun& run : segments) {
    if (found.stale_share > 0) mend_stale_rows(run.rows, found.n_p);
    if (found.current.form != Lateness::kNone)
      turn_currents(run.rows, found.n_p * found.current.lag.value, e.T_s());
  }
  find_flux(e, segments, found);
  const auto [d, q] = fit_inductances(found.L_d_points, found.L_q_points);
  found.L_d = d.L, found.saturation_d = d.saturation;
  found.saturation_q = q.saturation;
  if (q.saturation) found.L_q = q.L;
  note_rising_inductance(found);
  find_motion(e, segments, found);
}

}  // namespace twinrate
