// The part of one channel that all candidates together cannot explain: noise.
//
// Least squares on pieces spread over the record, weighted by the expected noise. Without the
// weights, slow columns would be determined far better than the whole noise allows, and their slow
// residual would look like slow noise. Products of unchanged columns are kept, because few columns
// change between two rounds of a trace.
#pragma once
#include <Eigen/Core>
#include <optional>
#include <vector>

#include "trace/whitening.hpp"

namespace twinrate {

class Unexplained {
 public:
  using Columns = std::vector<const Eigen::VectorXd*>;  // all of the length of y
  // Sets the expected noise; without it, noise is white.
  void expect(Whitener noise) { noise_ = std::move(noise); }
  bool expects() const { return noise_.has_value(); }
  void look_at(const Columns& x);
  // The residual of y after the first `count` columns; y itself if it is too short for that number.
  Eigen::VectorXd operator()(const Eigen::VectorXd& y, Eigen::Index count) const;

 private:
  // Applies the weights piece by piece.
  Eigen::VectorXd weighed(const Eigen::VectorXd& pieces) const;

  std::optional<Whitener> noise_;
  Columns x_;
  Eigen::MatrixXd X_;      // pieces of the columns, weighted, of unit norm
  Eigen::VectorXd scale_;  // factors of that normalisation
  Eigen::MatrixXd G_;      // X_' X_
};

}  // namespace twinrate
