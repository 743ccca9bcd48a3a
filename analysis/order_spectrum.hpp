// Amplitude spectrum of a signal over mechanical orders (periods a turn of the rotor), not over
// time.
//
//   signal(theta_m) = mean + sum_N amplitude_N sin(N theta_m + phase_N),  N = 1 .. N_max
//
// fitted by least squares, each sample weighted with the angle that it represents. Unlike a Fourier
// transform over time it does not smear where the speed varies, and unlike a sum over samples it
// does not leak where angles are jittered, missing or quantised: a signal that is made of these
// orders comes back exactly. The sum over samples of e^{j(N-M) theta} makes the normal equations
// Toeplitz, so their set-up costs O(samples N_max).
//
// Angles in rad, unwrapped, either direction, in order of time; amplitudes in the unit of the
// signal. Samples that are not finite are left out. Of a signal that reverses, the longest stretch
// in one direction is used. Orders with fewer than 2.2 samples a period cannot be told apart and
// are left out: amplitude may be shorter than N_max.
#pragma once
#include <cstddef>
#include <span>
#include <vector>

namespace twinrate {

struct OrderSpectrum {
  int turns = 0;  // whole turns used, the last ones; 0: less than one, and all below is empty
  std::size_t first = 0, last = 0;  // range [first, last) of the samples used
  double mean = 0;
  std::vector<double> amplitude;  // of order N at index N - 1
  std::vector<double> phase_rad;

  // Root mean square of orders 1 to `N_max` together.
  double rms(int N_max) const;
  // Noise level: the median amplitude of orders 1 to `N_max`, as long as fewer than half of them
  // are anything else. Of white noise an order exceeds kStandsOut times that with a chance
  // of 1.5e-5 (amplitudes are Rayleigh distributed: exp(-(1.177 m)^2/2) for m medians). 0 where
  // empty.
  double noise(int N_max) const;
  // sum of orders 1 to `N_max` at an angle, without the mean.
  double at(double theta_m, int N_max) const;
};

inline constexpr double kStandsOut = 4;

// Correlation coefficient over one turn of two signals made of orders 1 to `N_max`, their means
// left out: sum a_N b_N cos(phase_a - phase_b) / sqrt(sum a_N^2 sum b_N^2). Orders that only one of
// them has count as zero in the other. 1: the same shape; NaN where one of them has none.
// `turned` turns b back by that angle first (rad): b(theta_m + turned).
double shape_correlation(const OrderSpectrum& a, const OrderSpectrum& b, int N_max,
                         double turned = 0);

// Requires equally many angles and values, N_max >= 1.
OrderSpectrum order_spectrum(std::span<const double> theta_m, std::span<const double> signal,
                             int N_max);

}  // namespace twinrate
