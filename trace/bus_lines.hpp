// Sinusoids of constant frequency in an evenly sampled signal with gaps. An averaged spectrum finds
// them, least squares refines them.
#pragma once
#include <complex>
#include <cstddef>
#include <vector>

namespace twinrate {

// Rows [first, last) without a gap, with one clock.
struct BusPiece {
  std::size_t first = 0, last = 0;
};

// a sin(2 pi f t) + b cos(2 pi f t), and its standard deviations.
struct BusLine {
  double f = 0, a = 0, b = 0;
  double noise = 0;  // rms of a row, as white noise with the density beside the line
  double sigma_f = 0, sigma_amplitude = 0, sigma_phase = 0;
  double steady = 0;  // |sum| over sum of || of its parts along the record: 1 for one sine
  double amplitude() const;
  double phase() const;  // of the sine at t = 0
};

// Mean square by bin of Hann windows of `size` rows. A window lies within one run.
struct BusSpectrum {
  std::size_t size = 0, windows = 0;
  double df = 0;
  std::vector<double> power;  // of a row's value: white noise of variance s^2 has s^2 in every bin
  double amplitude(std::size_t bin) const;  // of a sine at the centre of the bin
};
BusSpectrum bus_spectrum(const std::vector<double>& x, const std::vector<BusPiece>& runs,
                         std::size_t size, double T_s);

// The strongest bin in [lowest, highest] that exceeds the bins on both sides; 0: none. `beside`:
// the power of the bins around it.
std::size_t strongest_peak(const BusSpectrum& spectrum, double lowest_Hz, double highest_Hz,
                           double& beside);

// Frequency between the bins: the vertex of a parabola through the logarithms of the three bins
// around `bin`.
double frequency_at(const BusSpectrum& spectrum, std::size_t bin);

// Refines all `lines` together on the rows of `runs` (Gauss-Newton) and computes their sigmas from
// `noise`. x is the signal less its moving mean over `window` rows.
void refine(const std::vector<double>& t, const std::vector<double>& x,
            const std::vector<BusPiece>& runs, std::size_t window, double T_s,
            std::vector<BusLine>& lines);
// The start value of a line, from the rotation of its phase along the record. `f` must be right to
// 0.15 bins, because evenly spaced parts also agree on other frequencies.
BusLine line_near(double f, const std::vector<double>& t, const std::vector<double>& x,
                  const std::vector<BusPiece>& runs, std::size_t size, std::size_t window,
                  double T_s);
// Share of a sine of frequency `f` that remains if the moving mean over `window` rows is
// subtracted.
double high_pass_gain(double f, std::size_t window, double T_s);
// y = A sin(2 pi f t + phase) in rows [first, last).
void put_sine(double f, double A, double phase, const std::vector<double>& t, std::size_t first,
              std::size_t last, std::vector<double>& y);
// 2 mean(x exp(-2 pi i f t)) over the rows: b - i a of the line; its modulus is the amplitude.
std::complex<double> part_at(double f, const std::vector<double>& t, const std::vector<double>& x,
                             std::size_t first, std::size_t last);

}  // namespace twinrate
