// A record at the rate that the tracer needs: one row for several.
//
// The tracer compares below 400 Hz. Residuals and columns at 10 kHz and more only cost time. With m
// rows in one, weights w_j = c(j/m)/m, |j| < 2 m, c the cubic through four points, and R(x) a
// rotation by n_p x,
//   theta_K = sum_j w_j theta[k + j],     k = m K + 2 m - 1
//   i_K     = sum_j w_j R(-j s_k) i[k + j]
//   u_K     = sum_j w_j R(-j s_k) (u[k + j] + .. + u[k + j + m - 1])/m
// all in stator axes, s_k the mean speed around row k, rad a row. The weights are the same for all
// signals, so an equation that holds from row to row holds from K to K + 1,
//   u_K = R_s i + (psi_{K+1} - psi_K)/(m T_s).
// The rotation is that of the flux, so a fast flux keeps its amplitude. Readings of the angle would
// turn each row by their errors: at constant speed the line of the counts would fold to a low
// frequency, where it looks like a harmonic of the flux, and the controller's response to a count
// times the error of that count has a mean, which looks like a lag. The weights reproduce a cubic
// exactly, so a function of theta is that of theta_K.
#pragma once
#include <cstddef>
#include <vector>

#include "trace/record.hpp"

namespace twinrate {

// Number of rows in one row of the tracer: 2 at 10 kHz, 1 below.
std::size_t rows_as_one(double T_s);
// A row is usable if all its rows are. A row across a step of time is left out.
Record thinned(const Record& record, std::size_t rows, int n_p);
// The same for other values by row of the record.
std::vector<char> thinned(const std::vector<char>& of_rows, const Record& record, std::size_t rows);
std::vector<int> thinned(const std::vector<int>& of_rows, const Record& record, std::size_t rows);

}  // namespace twinrate
