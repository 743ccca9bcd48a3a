// What all candidates together cannot explain of one channel: noise.
//
// Least squares on pieces spread over the record, weighed by what the noise should look like: slow
// columns are known far better than the whole noise lets them be, and a slow rest of them would
// pass for slow noise. The products of columns that are the same as the last time are kept: between
// two rounds of a trace few are made anew.
#pragma once
#include <Eigen/Core>
#include <optional>
#include <vector>

#include "trace/whitening.hpp"

namespace twinrate {

class Unexplained {
 public:
  using Columns = std::vector<const Eigen::VectorXd*>;  // all of the length of y
  // Of noise that is to be expected; without: white.
  void expect(Whitener noise) { noise_ = std::move(noise); }
  bool expects() const { return noise_.has_value(); }
  void look_at(const Columns& x);
  // What the first `count` of the columns leave of y; y itself where it is too short for so many.
  Eigen::VectorXd operator()(const Eigen::VectorXd& y, Eigen::Index count) const;

 private:
  // Piece by piece.
  Eigen::VectorXd weighed(const Eigen::VectorXd& pieces) const;

  std::optional<Whitener> noise_;
  Columns x_;
  Eigen::MatrixXd X_;      // pieces of the columns, weighed, of length one
  Eigen::VectorXd scale_;  // that made them so
  Eigen::MatrixXd G_;      // X_' X_
};

}  // namespace twinrate
