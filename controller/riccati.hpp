// Discrete linear-quadratic design from a continuous plant and a continuous cost.
//
//   x' = A x + B u                                     u held over T_s
//   J  = integral (x' Q x + u' R u) dt
//
// discretise_cost(), with F = [A B; 0 0] and W = diag(Q, R) (Van Loan 1978):
//
//   exp([-F' W; 0 F] T_s) = [. E; 0 Phi]
//   [A_d B_d; 0 I]        = Phi
//   [Q_d N_d; N_d' R_d]   = Phi' E
//   J                     = sum (x' Q_d x + 2 x' N_d u + u' R_d u)
//
// solve_riccati(), of that discrete problem (index d left out):
//
//   X = A' X A - (A' X B + N) (R + B' X B)^-1 (B' X A + N') + Q
//   K = (R + B' X B)^-1 (B' X A + N')
//   u = -K x
//
// by structured doubling, which converges quadratically (Chu, Fan, Lin, Wang 2004):
//
//   A_0 = A - B R^-1 N',  G_0 = B R^-1 B',  H_0 = Q - N R^-1 N'
//   W   = (I + G H)^-1
//   G  <- G + A W G A'
//   H  <- H + A' H W A                                 H -> X
//   A  <- A W A
//
// Shapes: A n by n, B n by m, Q n by n symmetric, N n by m, R m by m symmetric.
#pragma once
#include <Eigen/Core>
#include <complex>
#include <string>
#include <vector>

namespace twinrate {

struct DiscreteLqrProblem {
  Eigen::MatrixXd A, B, Q, N, R;
};

DiscreteLqrProblem discretise_cost(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B,
                                   const Eigen::MatrixXd& Q, const Eigen::MatrixXd& R, double T_s);

struct RiccatiSolution {
  Eigen::MatrixXd X, K;
  double residual = 0;  // of the equation, relative to the norm of X
  int iterations = 0;
  bool converged = false;  // and A - B K is stable
};

// If the pair is not stabilisable or the weights are not detectable, `converged` is false.
RiccatiSolution solve_riccati(const DiscreteLqrProblem& p);

// Eigenvalues of A - B K.
std::vector<std::complex<double>> closed_loop_poles(const Eigen::MatrixXd& A,
                                                    const Eigen::MatrixXd& B,
                                                    const Eigen::MatrixXd& K);

// Margins of the loop opened at the (single) plant input, with `delay` further samples in it.
struct Margins {
  double gain_up = 0, gain_down = 0;  // factors; infinite (0) if there is none
  double phase_rad = 0, crossover_rad_s = 0;
};
Margins margins(const Eigen::MatrixXd& A_d, const Eigen::MatrixXd& B_d, const Eigen::MatrixXd& K,
                int delay, double T_s);

}  // namespace twinrate
