// What all candidates together cannot explain of one channel: noise.
//
// Least squares on pieces spread over the record. The products of columns that are the same as the
// last time are kept: between two rounds of a trace few are made anew.
#pragma once
#include <Eigen/Core>
#include <vector>

namespace twinrate {

class Unexplained {
 public:
  using Columns = std::vector<const Eigen::VectorXd*>;  // all of the length of y
  void look_at(const Columns& x);
  // What the first `count` of the columns leave of y; y itself where it is too short for so many.
  Eigen::VectorXd operator()(const Eigen::VectorXd& y, Eigen::Index count) const;

 private:
  Columns x_;
  Eigen::MatrixXd X_;      // pieces of the columns, of length one
  Eigen::VectorXd scale_;  // that made them so
  Eigen::MatrixXd G_;      // X_' X_
};

}  // namespace twinrate
