#include "trace/sampler.hpp"

#include <algorithm>
#include <cmath>

#include "trace/fir.hpp"
#include "trace/signals.hpp"

namespace twinrate {
namespace {

constexpr double kSlowest = 0.15;      // rad/s: below it the speed does not determine the friction
constexpr int kHalfWidth = 5;          // outputs
constexpr double kSparse_Hz = 4000;    // least rate of rows for a smooth channel
constexpr std::size_t kShortest = 24;  // a run with fewer outputs is left out

// Nuttall's window (1981, four terms, continuous first derivative), x from -pi to pi: 93 dB and
// more beside its main lobe, falling. A torque from an angle's counts grows with the frequency
// squared: a window of 53 dB (Hamming) lets through a hundred times the torque that is present
// below 25 Hz.
double window(double x) {
  return 0.355768 + 0.487396 * std::cos(x) + 0.144232 * std::cos(2 * x) +
         0.012604 * std::cos(3 * x);
}

Eigen::VectorXd filtered(const std::vector<double>& taps, const std::vector<double>& x,
                         const Runs& runs, std::size_t before, std::size_t stride) {
  Eigen::VectorXd y(static_cast<Eigen::Index>(runs.row.size()));
  std::vector<std::size_t> first(runs.row.size());
  for (std::size_t n = 0; n < first.size(); ++n) first[n] = (runs.row[n] - before) / stride;
  filter_at(taps, x.data(), first, y.data());
  return y;
}

}  // namespace

std::vector<char> moving_rows(const Record& record) {
  std::vector<char> ok = record.motion_ok;
  const std::vector<double> omega_m = smooth_rate(record.theta_m, record.T_s, record.rows_each);
  for (std::size_t k = 0; k < ok.size(); ++k) ok[k] = ok[k] && std::abs(omega_m[k]) > kSlowest;
  return ok;
}

Sampler::Sampler(const Record& record, const std::vector<char>& torque_ok,
                 const std::vector<char>& held_out, double rate_Hz)
    : D_(std::max(1, static_cast<int>(std::lround(1 / (record.T_s * rate_Hz))))),
      M_(D_ == 1 ? 0 : kHalfWidth * D_) {
  double sum = 0;
  for (int j = -M_; j <= M_; ++j) {
    const double x = 2 * kPassband * j / D_;
    const double sinc = j == 0 ? 1 : std::sin(kPi * x) / (kPi * x);
    h_.push_back(sinc * window(M_ == 0 ? 0 : kPi * j / M_));
    sum += h_.back();
  }
  for (double& h : h_) h /= sum;
  for (int stride = 2; stride <= D_; ++stride)
    if (D_ % stride == 0 && 1 / (stride * record.T_s) >= kSparse_Hz) stride_ = stride;
  double sparse_sum = 0;
  for (int j = 0; j <= 2 * M_; j += stride_) sparse_.push_back(h_[j]), sparse_sum += h_[j];
  for (double& h : sparse_) h /= sparse_sum;
  if (record.has_voltage_equation()) electrical_ = runs_of(record.electrical_ok, held_out);
  torque_ = runs_of(torque_ok, held_out);
  for (std::size_t row : torque_.row)
    if (row > 0 && row + 1 < record.size())
      most_turned_ =
          std::max(most_turned_, std::abs(record.theta_m[row + 1] - record.theta_m[row - 1]) / 2);
}

Runs Sampler::runs_of(const std::vector<char>& ok, const std::vector<char>& held_out) const {
  Runs runs;
  const auto n = static_cast<std::ptrdiff_t>(ok.size());
  std::ptrdiff_t last_bad = -1;
  Runs run;
  const auto close = [&] {
    if (run.row.size() >= kShortest) {
      runs.start.push_back(runs.row.size());
      runs.row.insert(runs.row.end(), run.row.begin(), run.row.end());
      runs.held_out.insert(runs.held_out.end(), run.held_out.begin(), run.held_out.end());
    }
    run = {};
  };
  std::ptrdiff_t seen = -1;  // rows up to here have been checked
  // Differences reach one row further than the window, and the means of an interval two rows (a
  // window's own last taps are zero).
  const std::ptrdiff_t on = M_ == 0 ? 2 : M_ + 1;
  for (std::ptrdiff_t centre = M_ + 1; centre + on < n; centre += D_) {
    for (; seen < centre + on; ++seen)
      if (!ok[static_cast<std::size_t>(seen + 1)] ||
          (seen >= 0 && held_out[static_cast<std::size_t>(seen)] !=
                            held_out[static_cast<std::size_t>(seen + 1)]))
        last_bad = seen + 1;
    const bool usable = last_bad < centre - M_ - 1;
    if (!usable) {
      close();
      continue;
    }
    run.row.push_back(static_cast<std::size_t>(centre));
    run.held_out.push_back(held_out[static_cast<std::size_t>(centre)]);
  }
  close();
  return runs;
}

Eigen::VectorXd Sampler::operator()(const std::vector<double>& channel, const Runs& runs) const {
  return filtered(h_, channel, runs, static_cast<std::size_t>(M_), 1);
}

Eigen::VectorXd Sampler::sparsely(const std::vector<double>& channel, const Runs& runs) const {
  return filtered(sparse_, channel, runs, static_cast<std::size_t>(M_) + first(), stride());
}

}  // namespace twinrate
