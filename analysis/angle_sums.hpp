// Sums over samples at angles theta_i: the normal equations of a fit of orders.
//
//   W_m = sum_i w_i e^(jm theta_i)        m = 0 .. M
//   Y_m = sum_i w_i y_i e^(jm theta_i)    m = 0 .. M
//
// The samples are gathered on a grid of G angles, G a power of two. Each sample adds its powers d^p
// to the nearest grid angle. A power series replaces the distance to that angle, and one Fourier
// transform a power replaces the sums over the samples:
//
//   theta_i = 2 pi g_i/G + h d_i,   h = pi/G,   |d_i| <= 1
//   W_m     = sum_p (j m h)^p/p! sum_g e^(jm 2 pi g/G) sum_(i: g_i = g) w_i d_i^p,   p = 0 .. 15
//
// G is chosen so that M h <= 0.8: the truncation error of the series is below 0.8^16/16! = 1.4e-15
// of the sum of the weights. A sample costs about 50 instructions, for any M.
#pragma once
#include <complex>
#include <span>
#include <vector>

namespace twinrate {

struct AngleSums {
  std::vector<std::complex<double>> weights, values;  // W_m, Y_m at index m
};

// Requires as many weights and values as angles, M >= 0. Angles in rad, of any number of turns.
AngleSums angle_sums(std::span<const double> theta, std::span<const double> w,
                     std::span<const double> y, int M);

}  // namespace twinrate
