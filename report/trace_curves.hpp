// Numbers behind the pictures of a trace: means over bins, smoothing, spectra. Pure functions of
// equal-length rows; units are those of the rows.
#pragma once
#include <cstddef>
#include <utility>
#include <vector>

namespace twinrate::report {

// Points of a picture: residual e and the effect's share s of it over x, both in units of a
// reference signal g (1: as they are): e = y g.
struct Points {
  std::vector<double> x, e, share, g;
  std::vector<char> held_out;
};

// In each bin the least-squares y of e = y g, apart for rows that were fitted and rows kept back:
// the share of all rows of the bin plus what the rows of one kind leave, so that both kinds can be
// held against one curve where the share depends on more than x.
struct Bins {
  std::vector<double> x;  // mean of the bin's rows, ascending; bins with too few rows are left out
  std::vector<double> trained, trained_error, held_out, held_out_error, share;  // NaN: no rows
};
// `count` bins of equal width over [lo, hi]. Errors are two standard errors of the mean.
Bins bin(const Points& points, double lo, double hi, int count);

// The given share of the ordered values lies between the two.
std::pair<double, double> middle(std::vector<double> x, double share);

// Moving average over 2 half + 1 rows that follow each other at 1/rate_Hz; fewer at gaps.
std::vector<double> smooth(const std::vector<double>& y, const std::vector<double>& t,
                           double rate_Hz, std::size_t half);
// The widest such half-width (a power of two, 0 to 64) that keeps 90 % of the power of y.
std::size_t widest_half(const std::vector<double>& y, const std::vector<double>& t, double rate_Hz);

// Amplitudes of the whole orders 1 .. `highest` of y over the angle: of its means over equal bins
// of one turn. Empty where the rows do not cover the turn.
std::vector<double> order_amplitudes(const std::vector<double>& theta_m,
                                     const std::vector<double>& y, int highest);

// Largest amplitude in each of at most `points` bands of frequency, of a Hann-windowed transform of
// the whole record (gaps count as nothing): a line of amplitude A stands at A.
struct Spectrum {
  std::vector<double> f_Hz, amplitude;
  double resolution_Hz = 0;
};
Spectrum line_spectrum(const std::vector<double>& t, const std::vector<double>& y, double rate_Hz,
                       std::size_t points = 700);

// Stretches of t in which rows are kept back.
std::vector<std::pair<double, double>> stretches(const std::vector<double>& t,
                                                 const std::vector<char>& held_out);

}  // namespace twinrate::report
