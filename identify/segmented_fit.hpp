// Least squares over segments: some parameters are shared by all segments, others are free in each.
//
//   y_s = L_s a_s + S_s x + e_s          s = 1 .. n
//
// a_s (initial values, drifts) are eliminated by a QR of L_s. The error of x comes from the
// jackknife, which is valid although the rows of a segment are correlated (sums of noise).
//
//   sigma^2 = (n-1)/n sum_s (x_(s) - mean)^2          x_(s): without segment s     (Efron 1979)
#pragma once
#include <Eigen/Core>
#include <vector>

namespace twinrate {

class SegmentedFit {
 public:
  explicit SegmentedFit(Eigen::Index shared) : shared_(shared) {}

  // `local`: rows x a_s, `shared`: rows x x, `y`: rows.
  void add(const Eigen::MatrixXd& local, const Eigen::MatrixXd& shared, const Eigen::VectorXd& y);

  struct Solution {
    Eigen::VectorXd x, sigma;  // 0 if not used; sigma infinite with fewer than three segments
    double rms = 0;            // of the residual
  };
  // Solves for the parameters in `used` (indices of x); the others are zero.
  Solution solve(const std::vector<Eigen::Index>& used) const;
  std::size_t segments() const { return parts_.size(); }

 private:
  struct Part {
    Eigen::MatrixXd N;
    Eigen::VectorXd b;
    double yy = 0;
    Eigen::Index rows = 0;
  };
  Eigen::Index shared_;
  std::vector<Part> parts_;
};

}  // namespace twinrate
