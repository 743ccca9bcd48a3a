#include "trace/angle_error.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <limits>
#include <utility>
#include <vector>

#include "model/frames.hpp"
#include "trace/keys.hpp"

namespace twinrate {
namespace {

struct Masses {
  double motor = 0;
  ShaftFacts shaft;
  bool rigid() const { return !(shaft.J_load > 0); }
  double whole() const { return motor + shaft.J_load; }
};

Masses masses(const Members& members, const MachineParameters& m) {
  Masses out{.motor = m.J, .shaft = {}};
  for (const auto& member : members) {
    if (has_key(*member, "change_kgm2")) out.motor += get_key(*member, "change_kgm2");
    member->describe_shaft(out.shaft);
  }
  out.motor -= out.shaft.J_load;
  return out;
}

// Z / (J s^2), by the bilinear transform. If there is a shaft already, only the motor's share
// counts.
class AngleError {
 public:
  AngleError(const Masses& with, const Masses& without, double T_s)
      : motor_(with.motor / (without.rigid() ? without.whole() : without.motor)) {
    if (with.rigid() || !without.rigid()) return;
    load_ = with.shaft.J_load / without.whole();
    constexpr double kNyquist = 2.8;  // rad a row
    const double w2 = with.shaft.stiffness / with.shaft.J_load,
                 damping = with.shaft.damping / with.shaft.J_load;
    if (std::sqrt(w2) * T_s > kNyquist) return;
    const double c = std::sqrt(w2) / std::tan(std::sqrt(w2) * T_s / 2);
    const double a0 = c * c + damping * c + w2;
    b_ = {(damping * c + w2) / a0, 2 * w2 / a0, (w2 - damping * c) / a0};
    a_ = {(2 * w2 - 2 * c * c) / a0, (c * c - damping * c + w2) / a0};
  }
  double motor() const { return motor_; }  // share of the inertia that stays at the motor
  // Starts a run in the steady state of its first row.
  void start(double x) { before_ = last_ = {x, x}; }
  double operator()(double x) {
    const double y =
        b_[0] * x + b_[1] * last_.in + b_[2] * before_.in - a_[0] * last_.out - a_[1] * before_.out;
    before_ = std::exchange(last_, {x, y});
    return motor_ * x + load_ * y;
  }

 private:
  struct Row {
    double in = 0, out = 0;
  };
  double motor_, load_ = 0;
  std::array<double, 3> b_{1, 0, 0};
  std::array<double, 2> a_{0, 0};
  Row before_, last_;
};

// Energies at the frequencies of one window.
using Spectrum = Eigen::ArrayXd;

Eigen::MatrixXcd fourier(Eigen::Index window) {
  Eigen::MatrixXcd out(window / 2 + 1, window);
  const double turn = kTwoPi / static_cast<double>(window);
  for (Eigen::Index f = 0; f < out.rows(); ++f)
    for (Eigen::Index k = 0; k < window; ++k)
      out(f, k) = std::polar(0.5 - 0.5 * std::cos(turn * static_cast<double>(k)),
                             -turn * static_cast<double>(f * k));
  return out;
}

struct Range {
  Eigen::Index first, count;
};
std::vector<Range> judging_runs(const Runs& runs) {
  std::vector<Range> out;
  for (std::size_t r = 0; r < runs.start.size(); ++r) {
    const std::size_t first = runs.start[r],
                      end = r + 1 < runs.start.size() ? runs.start[r + 1] : runs.row.size();
    if (first < end && runs.held_out[first])
      out.push_back({static_cast<Eigen::Index>(first), static_cast<Eigen::Index>(end - first)});
  }
  return out;
}

// Mean over frequencies of ln(energy of a / energy of b), in windows of at most 64 rows and at most
// three quarters of the longest run.
double mean_log_ratio(const Eigen::VectorXd& a, const Eigen::VectorXd& b,
                      const std::vector<Range>& ranges) {
  constexpr Eigen::Index kLongest = 64, kShortest = 16;
  Eigen::Index longest_run = 0;
  for (const Range& range : ranges) longest_run = std::max(longest_run, range.count);
  Eigen::Index window = kLongest;
  while (window > kShortest && 4 * window > 3 * longest_run) window /= 2;
  if (window > longest_run) return std::numeric_limits<double>::quiet_NaN();
  const Eigen::MatrixXcd transform = fourier(window);
  Spectrum of_a = Spectrum::Zero(window / 2 + 1), of_b = of_a;
  for (const Range& range : ranges)
    for (Eigen::Index k = 0; k + window <= range.count; k += window / 2) {
      of_a += (transform * a.segment(range.first + k, window)).array().abs2();
      of_b += (transform * b.segment(range.first + k, window)).array().abs2();
    }
  return (of_a / of_b).log().mean();
}

}  // namespace

bool is_lighter(const Members& claimed, const Members& others, const MachineParameters& machine) {
  return AngleError(masses(claimed, machine), masses(others, machine), 1).motor() < 1;
}

AngleErrorFall fall_of_angle_error(const Members& claimed, const Eigen::VectorXd& with,
                                   const Members& others, const Eigen::VectorXd& without,
                                   const MachineParameters& machine, const Runs& runs, double T_s) {
  AngleError error(masses(claimed, machine), masses(others, machine), T_s);
  const std::vector<Range> ranges = judging_runs(runs);
  Eigen::VectorXd left = Eigen::VectorXd::Zero(without.size());
  double before = 0, after = 0;
  for (const Range& range : ranges) {
    error.start(without[range.first]);
    for (Eigen::Index k = range.first; k < range.first + range.count; ++k)
      left[k] = error(without[k]);
    before += without.segment(range.first, range.count).squaredNorm();
    after += left.segment(range.first, range.count).squaredNorm();
  }
  if (!(before > 0)) return {};
  return {.lighter = error.motor() < 1,
          .share = 1 - after / before,
          .loose = 1 - error.motor() * error.motor(),
          .log_ratio = after > 0 ? mean_log_ratio(with, left, ranges)
                                 : std::numeric_limits<double>::infinity()};
}

}  // namespace twinrate
