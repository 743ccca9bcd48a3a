// A record at the rate that the tracer needs: several rows as one.
//
// The tracer compares below 400 Hz; residuals and columns at 10 kHz and more cost time alone. With
// m rows as one, weights w_j = c(j/m)/m, |j| < 2 m, c the cubic through four points, and R(x) a
// turn by n_p x,
//   theta_K = sum_j w_j theta[k + j],     k = m K + 2 m - 1
//   i_K     = sum_j w_j R(theta[k] - theta[k + j]) i[k + j]
//   u_K     = sum_j w_j R(theta[k] - theta[k + j]) (u[k + j] + .. + u[k + j + m - 1])/m
// all in stator axes. One weight for all signals: what held from row to row holds from K to K + 1,
//   u_K = R_s i + (psi_{K+1} - psi_K)/(m T_s),
// and the turn, which is that of the flux, keeps a fast one as large as it is. A cubic passes the
// weights as it is: what is a function of theta is that of theta_K.
#pragma once
#include <cstddef>
#include <vector>

#include "trace/record.hpp"

namespace twinrate {

// Rows that are one for the tracer: 2 at 10 kHz, 1 below.
std::size_t rows_as_one(double T_s);
// A row can be used where all can that it is made of; rows that would be made of what is apart in
// time are left out.
Record thinned(const Record& record, std::size_t rows, int n_p);
// Of something else that the record has by the row.
std::vector<char> thinned(const std::vector<char>& of_rows, const Record& record, std::size_t rows);
std::vector<int> thinned(const std::vector<int>& of_rows, const Record& record, std::size_t rows);

}  // namespace twinrate
