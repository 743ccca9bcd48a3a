// Sinusoids of steady frequency in an evenly sampled signal with gaps: found in an averaged
// spectrum, refined by least squares.
#pragma once
#include <complex>
#include <cstddef>
#include <vector>

namespace twinrate {

// Rows [first, last) without a gap, of one clock.
struct BusPiece {
  std::size_t first = 0, last = 0;
};

// a sin(2 pi f t) + b cos(2 pi f t), and what noise of the rows leaves of it.
struct BusLine {
  double f = 0, a = 0, b = 0;
  double noise = 0;  // rms of a row, of white noise as dense as what stands beside the line
  double sigma_f = 0, sigma_amplitude = 0, sigma_phase = 0;
  double steady = 0;  // |sum| over sum of || of its parts along the record: 1 is one sine
  double amplitude() const;
  double phase() const;  // of the sine at t = 0
};

// Of windows of `size` rows (Hann), mean square by bin; windows that no run of `rows` holds count
// not.
struct BusSpectrum {
  std::size_t size = 0, windows = 0;
  double df = 0;
  std::vector<double> power;  // of a row's value: white noise of variance s^2 has s^2 in every bin
  double amplitude(std::size_t bin) const;  // of a sine in the middle of it
};
BusSpectrum bus_spectrum(const std::vector<double>& x, const std::vector<BusPiece>& runs,
                         std::size_t size, double T_s);

// The strongest bin in [lowest, highest] that stands out on both sides; 0: none. `beside`: power of
// the bins around it.
std::size_t strongest_peak(const BusSpectrum& spectrum, double lowest_Hz, double highest_Hz,
                           double& beside);

// Between the bins: the top of a parabola through the logarithms of the three around `bin`.
double frequency_at(const BusSpectrum& spectrum, std::size_t bin);

// `lines` refined together on the rows of `runs` (Gauss-Newton), their sigmas with `noise`; x holds
// (1 - mean of `window` rows) of the signal.
void refine(const std::vector<double>& t, const std::vector<double>& x,
            const std::vector<BusPiece>& runs, std::size_t window, double T_s,
            std::vector<BusLine>& lines);
// The start of it, from the turning of the phase along the record. `f` has to be right to 0.15
// bins: parts that stand at even distances agree on other frequencies, too.
BusLine line_near(double f, const std::vector<double>& t, const std::vector<double>& x,
                  const std::vector<BusPiece>& runs, std::size_t size, std::size_t window,
                  double T_s);
// What is left of a sine of `f` by taking off the mean of `window` rows around each.
double high_pass_gain(double f, std::size_t window, double T_s);
// y = A sin(2 pi f t + phase) in rows [first, last).
void put_sine(double f, double A, double phase, const std::vector<double>& t, std::size_t first,
              std::size_t last, std::vector<double>& y);
// Mean of x exp(-2 pi i f t) over the rows, times 2: a - i b turned; its size is the amplitude.
std::complex<double> part_at(double f, const std::vector<double>& t, const std::vector<double>& x,
                             std::size_t first, std::size_t last);

}  // namespace twinrate
