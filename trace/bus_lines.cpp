#include "trace/bus_lines.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <unsupported/Eigen/FFT>

#include "model/frames.hpp"

namespace twinrate {
namespace {

constexpr std::size_t kSync = 256;   // rows after which a pointer is computed anew
constexpr std::size_t kNear = 3;     // bins of a Hann window's own peak, each side
constexpr std::size_t kAround = 16;  // bins beyond those that give the level beside it
constexpr double kStandsOut = 12;    // power over that level
constexpr int kRounds = 4;           // of Gauss-Newton
constexpr double kReach = 0.15;      // bins

using Complex = std::complex<double>;

// exp(2 pi i f t) at rows T_s apart, in sequence.
class Pointer {
 public:
  Pointer(double f, double T_s) : f_(f), turn_(std::polar(1.0, kTwoPi * f * T_s)) {}
  Complex at(std::size_t row, double t) {
    now_ =
        row % kSync == 0 || !set_ ? std::polar(1.0, kTwoPi * std::fmod(f_ * t, 1.0)) : now_ * turn_;
    set_ = true;
    return now_;
  }

 private:
  double f_;
  Complex turn_, now_;
  bool set_ = false;
};

double median(std::vector<double> x) {
  if (x.empty()) return 0;
  const auto middle = x.begin() + static_cast<std::ptrdiff_t>(x.size() / 2);
  std::nth_element(x.begin(), middle, x.end());
  return *middle;
}

// Logs round their times, so the step of one pair of rows is not that of the piece.
double mean_step(const std::vector<double>& t, std::size_t first, std::size_t last) {
  return last - first > 1 ? (t[last - 1] - t[first]) / static_cast<double>(last - 1 - first) : 0;
}

}  // namespace

double BusLine::amplitude() const {
  return std::hypot(a, b);
}
double BusLine::phase() const {
  return std::atan2(b, a);
}

double BusSpectrum::amplitude(std::size_t bin) const {
  // Hann: sum of weights n/2, of their squares 3n/8.
  return 2 * std::sqrt(power[bin] * 1.5 / static_cast<double>(size));
}

BusSpectrum bus_spectrum(const std::vector<double>& x, const std::vector<BusPiece>& runs,
                         std::size_t size, double T_s) {
  BusSpectrum s{.size = size, .df = 1 / (T_s * static_cast<double>(size)), .power = {}};
  s.power.assign(size / 2, 0.0);
  std::vector<double> hann(size), part(size);
  for (std::size_t k = 0; k < size; ++k)
    hann[k] = 0.5 - 0.5 * std::cos(kTwoPi * static_cast<double>(k) / static_cast<double>(size));
  Eigen::FFT<double> fft;
  std::vector<Complex> bins;
  for (const BusPiece& run : runs)
    for (std::size_t first = run.first; first + size <= run.last; first += size / 2) {
      for (std::size_t k = 0; k < size; ++k) part[k] = hann[k] * x[first + k];
      fft.fwd(bins, part);
      for (std::size_t b = 0; b < s.power.size(); ++b) s.power[b] += std::norm(bins[b]);
      ++s.windows;
    }
  const double scale =
      1 / (0.375 * static_cast<double>(size) * std::max(1.0, static_cast<double>(s.windows)));
  for (double& power : s.power) power *= scale;
  return s;
}

std::size_t strongest_peak(const BusSpectrum& s, double lowest_Hz, double highest_Hz,
                           double& beside) {
  std::size_t best = 0;
  const auto first = static_cast<std::size_t>(std::ceil(lowest_Hz / s.df));
  const auto last = std::min(s.power.size() - 1, static_cast<std::size_t>(highest_Hz / s.df));
  const auto around = [&](std::size_t from, std::size_t to) {
    from = std::max<std::size_t>(from, 1), to = std::min(to, s.power.size());
    if (from >= to) return 0.0;
    return median({s.power.begin() + static_cast<std::ptrdiff_t>(from),
                   s.power.begin() + static_cast<std::ptrdiff_t>(to)});
  };
  for (std::size_t b = std::max(first, kNear + 2); b < last; ++b) {
    if (s.power[b] < s.power[b - 1] || s.power[b] < s.power[b + 1]) continue;
    if (best > 0 && s.power[b] <= s.power[best]) continue;
    const std::size_t below = b > kNear + kAround ? b - kNear - kAround : 1;
    const double level =
        std::max(around(below, b - kNear), around(b + kNear + 1, b + kNear + 1 + kAround));
    if (s.power[b] < kStandsOut * level) continue;
    best = b;
    beside = level;
  }
  return best;
}

double frequency_at(const BusSpectrum& s, std::size_t bin) {
  const auto level = [&](std::size_t b) { return std::log(std::max(s.power[b], 1e-300)); };
  const double before = level(bin - 1), here = level(bin), after = level(bin + 1);
  const double bend = before - 2 * here + after;
  const double off = bend < 0 ? std::clamp(0.5 * (before - after) / bend, -0.5, 0.5) : 0;
  return s.df * (static_cast<double>(bin) + off);
}

double high_pass_gain(double f, std::size_t window, double T_s) {
  const double half = kPi * f * T_s, n = static_cast<double>(window);
  return 1 - std::sin(n * half) / (n * std::sin(half));
}

std::complex<double> part_at(double f, const std::vector<double>& t, const std::vector<double>& x,
                             std::size_t first, std::size_t last) {
  if (last <= first) return 0;
  Pointer pointer(f, mean_step(t, first, last));
  Complex sum = 0;
  for (std::size_t k = first; k < last; ++k) sum += x[k] * std::conj(pointer.at(k, t[k]));
  return 2.0 * sum / static_cast<double>(last - first);
}

void put_sine(double f, double A, double phase, const std::vector<double>& t, std::size_t first,
              std::size_t last, std::vector<double>& y) {
  if (last <= first) return;
  Pointer pointer(f, mean_step(t, first, last));
  const Complex start = std::polar(A, phase);
  for (std::size_t k = first; k < last; ++k) y[k] = (start * pointer.at(k, t[k])).imag();
}

BusLine line_near(double f, const std::vector<double>& t, const std::vector<double>& x,
                  const std::vector<BusPiece>& runs, std::size_t size, std::size_t window,
                  double T_s) {
  struct Part {
    Complex c;
    double t;
  };
  std::vector<Part> parts;
  double size_of_all = 0;
  for (const BusPiece& run : runs)
    for (std::size_t first = run.first; first + size <= run.last; first += size) {
      parts.push_back({part_at(f, t, x, first, first + size), t[first + size / 2]});
      size_of_all += std::abs(parts.back().c);
    }
  BusLine line{.f = f};
  if (parts.empty() || size_of_all == 0) return line;
  // Each part has the phase that the error of the frequency makes at its middle.
  const double span = parts.back().t - parts.front().t;
  const double reach = kReach / (static_cast<double>(size) * T_s);
  const double step = std::min(reach, 0.125 / std::max(span, 1e-9));
  Complex best = 0;
  double off = 0;
  for (double d = -reach; d <= reach + 0.5 * step; d += step) {
    Complex sum = 0;
    for (const Part& p : parts) sum += p.c * std::polar(1.0, -kTwoPi * d * p.t);
    if (std::abs(sum) > std::abs(best)) best = sum, off = d;
  }
  line.f = f + off;
  line.steady = std::abs(best) / size_of_all;
  const double gain = high_pass_gain(line.f, window, T_s) * static_cast<double>(parts.size());
  line.b = best.real() / gain;
  line.a = -best.imag() / gain;
  return line;
}

void refine(const std::vector<double>& t, const std::vector<double>& x,
            const std::vector<BusPiece>& runs, std::size_t window, double T_s,
            std::vector<BusLine>& lines) {
  if (lines.empty() || runs.empty()) return;
  const auto P = static_cast<Eigen::Index>(3 * lines.size());
  const double origin = 0.5 * (t[runs.front().first] + t[runs.back().last - 1]);
  Eigen::MatrixXd normal;
  for (int round = 0; round < kRounds; ++round) {
    normal = Eigen::MatrixXd::Zero(P, P);
    Eigen::VectorXd right = Eigen::VectorXd::Zero(P), row(P);
    std::vector<Pointer> pointers;
    std::vector<double> gains;
    gains.reserve(lines.size());
    for (const BusLine& line : lines) gains.push_back(high_pass_gain(line.f, window, T_s));
    for (const BusPiece& run : runs) {
      pointers.clear();
      for (const BusLine& line : lines) pointers.emplace_back(line.f, T_s);
      for (std::size_t k = run.first; k < run.last; ++k) {
        double rest = x[k];
        for (std::size_t n = 0; n < lines.size(); ++n) {
          const Complex turn = gains[n] * pointers[n].at(k, t[k]);
          const BusLine& line = lines[n];
          const auto at = static_cast<Eigen::Index>(3 * n);
          row[at] = turn.imag();
          row[at + 1] = turn.real();
          row[at + 2] = kTwoPi * (t[k] - origin) * (line.a * turn.real() - line.b * turn.imag());
          rest -= line.a * row[at] + line.b * row[at + 1];
        }
        normal.selfadjointView<Eigen::Lower>().rankUpdate(row);
        right += rest * row;
      }
    }
    normal = Eigen::MatrixXd(normal.selfadjointView<Eigen::Lower>());
    const Eigen::VectorXd change = normal.ldlt().solve(right);
    for (std::size_t n = 0; n < lines.size(); ++n) {
      const auto at = static_cast<Eigen::Index>(3 * n);
      // a and b give the phase at t = 0: a change of f rotates it about `origin`.
      const Complex c = Complex(lines[n].b + change[at + 1], -(lines[n].a + change[at])) *
                        std::polar(1.0, -kTwoPi * change[at + 2] * origin);
      lines[n].b = c.real();
      lines[n].a = -c.imag();
      lines[n].f += change[at + 2];
    }
  }
  const Eigen::MatrixXd inverse = normal.ldlt().solve(Eigen::MatrixXd::Identity(P, P));
  for (std::size_t n = 0; n < lines.size(); ++n) {
    BusLine& line = lines[n];
    const auto at = static_cast<Eigen::Index>(3 * n);
    const double A = line.amplitude();
    const auto deviation = [&](const Eigen::Vector3d& slope) {
      return line.noise * std::sqrt(std::max(0.0, slope.dot(inverse.block<3, 3>(at, at) * slope)));
    };
    line.sigma_f = deviation({0, 0, 1});
    line.sigma_amplitude = deviation({line.a / A, line.b / A, 0});
    line.sigma_phase = deviation({-line.b / (A * A), line.a / (A * A), -kTwoPi * origin});
  }
}

}  // namespace twinrate
