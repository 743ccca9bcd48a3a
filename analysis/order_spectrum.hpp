// Amplitude spectrum of a signal over mechanical orders (periods a turn of the rotor).
//
//   signal(theta_m) = mean + sum_N amplitude_N sin(N theta_m + phase_N),  N = 1 .. N_max
//
// fitted by least squares; the weight of a sample is the angle between its neighbours. A varying
// speed does not smear the orders, as it does in a Fourier transform over time. Jittered, missing
// or quantised angles cause no leakage: a signal of these orders is recovered exactly. The normal
// equations are Toeplitz in the sums of e^{j(N-M) theta} (analysis/angle_sums.hpp).
//
// Angles in rad, unwrapped, either direction, in order of time; amplitudes in the unit of the
// signal. Samples that are not finite are ignored. If the rotor reverses, the longest stretch in
// one direction is used. Orders with fewer than 2.2 samples a period are not identifiable and are
// omitted: `amplitude` may be shorter than N_max.
#pragma once
#include <cstddef>
#include <span>
#include <vector>

namespace twinrate {

struct OrderSpectrum {
  int turns = 0;  // number of whole turns used, the last ones; 0: less than one turn, no result
  std::size_t first = 0, last = 0;  // range [first, last) of the samples used
  double mean = 0;
  std::vector<double> amplitude;  // of order N at index N - 1
  std::vector<double> phase_rad;

  // Root mean square of orders 1 to `N_max` together.
  double rms(int N_max) const;
  // Noise level: the median amplitude of orders 1 to `N_max`; valid while fewer than half of the
  // orders hold a signal. White noise exceeds kDetectionRatio times this level with probability
  // 1.5e-5 (amplitudes are Rayleigh distributed: exp(-(1.177 m)^2/2) for m medians). 0 if empty.
  double noise(int N_max) const;
  // Sum of orders 1 to `N_max` at an angle, without the mean.
  double at(double theta_m, int N_max) const;
};

// An order is detected above this ratio of amplitude to noise level.
inline constexpr double kDetectionRatio = 4;

// Correlation coefficient over one turn of two signals of orders 1 to `N_max`, without their means:
//   sum a_N b_N cos(phase_a - phase_b) / sqrt(sum a_N^2 sum b_N^2)
// An order missing in one signal is zero. 1: equal shapes; NaN if a signal has no orders.
// `turned` (rad) shifts b: b(theta_m + turned).
double shape_correlation(const OrderSpectrum& a, const OrderSpectrum& b, int N_max,
                         double turned = 0);

// Requires equally many angles and values, N_max >= 1.
OrderSpectrum order_spectrum(std::span<const double> theta_m, std::span<const double> signal,
                             int N_max);

}  // namespace twinrate
