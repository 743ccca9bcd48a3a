// Discrete linear-quadratic design from a continuous plant and a continuous cost.
//
//   x' = A x + B u,   J = integral (x' Q x + u' R u) dt,   u held over T_s
//   discretise_cost   A_d, B_d and the cost sum x'Q_d x + 2 x'N_d u + u'R_d u          (Van Loan
//   1978) solve_riccati     X = A'X A - (A'X B + N)(R + B'X B)^-1 (B'X A + N') + Q
//                     by structured doubling (Chu, Fan, Lin, Wang 2004): quadratic convergence
//   K = (R + B'X B)^-1 (B'X A + N'),  u = -K x
//
// Shapes: A n by n, B n by m, Q n by n symmetric, R m by m symmetric.
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

// Where the pair is not stabilisable or the weights are not detectable, `converged` is false.
RiccatiSolution solve_riccati(const DiscreteLqrProblem& p);

// Eigenvalues of A - B K.
std::vector<std::complex<double>> closed_loop_poles(const Eigen::MatrixXd& A,
                                                    const Eigen::MatrixXd& B,
                                                    const Eigen::MatrixXd& K);

// Margins of the loop opened at the (single) plant input, with `delay` further samples in it.
struct Margins {
  double gain_up = 0, gain_down = 0;  // factors; infinite (0) where there is none
  double phase_rad = 0, crossover_rad_s = 0;
};
Margins margins(const Eigen::MatrixXd& A_d, const Eigen::MatrixXd& B_d, const Eigen::MatrixXd& K,
                int delay, double T_s);

}  // namespace twinrate
