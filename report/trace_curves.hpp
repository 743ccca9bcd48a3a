// Data of the pictures of a trace: means over bins, smoothing, spectra. Pure functions of rows of
// equal length; units are those of the rows.
#pragma once
#include <cstddef>
#include <utility>
#include <vector>

namespace twinrate::report {

// Points of a picture over x: residual e and the contribution `share` of the effect to it. The
// ordinate y is defined by e = y g with a reference signal g (1: y = e).
struct Points {
  std::vector<double> x, e, share, g;
  std::vector<char> held_out;
};

// The least-squares y of e = y g in each bin, separately for training and held-out rows: `share` of
// all rows of the bin plus the residual of the rows of one kind. Both kinds can then be compared
// with one curve, even if the share depends on more than x.
struct Bins {
  std::vector<double> x;  // mean of the bin's rows, ascending; bins with too few rows are omitted
  std::vector<double> trained, trained_error, held_out, held_out_error, share;  // NaN: no rows
};
// `count` bins of equal width over [lo, hi]. Errors are two standard errors of the mean.
Bins bin(const Points& points, double lo, double hi, int count);

// Two quantiles; the given central share of the values lies between them.
std::pair<double, double> middle(std::vector<double> x, double share);

// Moving average over 2 half + 1 consecutive rows (spacing 1/rate_Hz); fewer rows at gaps.
std::vector<double> smooth(const std::vector<double>& y, const std::vector<double>& t,
                           double rate_Hz, std::size_t half);
// The largest half-width (0 or a power of two up to 64) that keeps 90 % of the power of y.
std::size_t widest_half(const std::vector<double>& y, const std::vector<double>& t, double rate_Hz);

// Amplitudes of the orders 1 .. `highest` of y over the angle, from means over equal bins of one
// turn. Empty if the rows do not cover the turn.
std::vector<double> order_amplitudes(const std::vector<double>& theta_m,
                                     const std::vector<double>& y, int highest);

// Largest amplitude in each of at most `points` frequency bands of the Hann-windowed transform of
// the whole record, gaps as zeros. A line of amplitude A has the value A.
struct Spectrum {
  std::vector<double> f_Hz, amplitude;
  double resolution_Hz = 0;
};
Spectrum line_spectrum(const std::vector<double>& t, const std::vector<double>& y, double rate_Hz,
                       std::size_t points = 700);

// Intervals of t with held-out rows.
std::vector<std::pair<double, double>> stretches(const std::vector<double>& t,
                                                 const std::vector<char>& held_out);

}  // namespace twinrate::report
