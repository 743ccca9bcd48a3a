// Whether parts of the data agree in what a claim predicts.
//
// The residual is taken as linear in the members' coefficients, its columns those at the fit. With
// the sums of their products over a part all that is asked of it is algebra: its own best answer,
// and what the answer of another part leaves there, the other members free in both.
#pragma once
#include "trace/fit.hpp"

namespace twinrate {

// The members' columns; of one without coefficients its whole contribution, with coefficient 1.
struct MemberColumns {
  std::vector<Sampled> x;
  std::vector<std::size_t> member;
  Eigen::VectorXd value;  // in the fit
  Sampled declared;       // residual with all coefficients 0
};
MemberColumns member_columns(const Chain& chain, const Members& members);

// Sums over the rows of a part, nothing taken off for noise: columns with columns, and with the
// declared model's residual.
struct PartSums {
  Eigen::MatrixXd A;
  Eigen::VectorXd b;
  double energy = 0, count = 0;

  PartSums(const MemberColumns& columns, const Rows& rows);
  // Of rows as they stand: y = x beta + rest.
  PartSums(const Eigen::MatrixXd& x, const Eigen::VectorXd& y);
  PartSums operator+(const PartSums& other) const;
};

struct Agreement {
  double kept = 1;           // least share of a part's own gain
  int compared = 0;          // parts on which another's answer was tried
  const char* between = "";  // where the least was
  double size_ratio = 1;     // at half the rate over that at the record's: of what it predicts
};

// The best answer of a part, nothing taken off for noise, with the coefficients of `held` given.
struct PartAnswer {
  Eigen::VectorXd beta;
  double energy = 0;  // raw
};
PartAnswer best_answer(const PartSums& part, const std::vector<char>& held,
                       const Eigen::VectorXd& given);
// Adds to `out` how much of its gain on `on` the answer of `from` keeps. `own`: the coefficients of
// the claim; `least`: a gain below so many mean squares of the rest moves no part.
void compare_parts(const PartSums& from, const PartSums& on, const std::vector<char>& own,
                   double least, const char* between, Agreement& out);

// What `other` predicts along what `one` predicts, over that; `A`: products of the columns. Coefficients of
// which the data show no more than a difference may be anything.
double predicted_ratio(const Eigen::MatrixXd& A, const Eigen::VectorXd& one,
                       const Eigen::VectorXd& other);

class Parts {
 public:
  // `half_rate`: null where there is none.
  Parts(const Chain& whole, const Members& members, const Chain* half_rate);
  // `sigmas`: a part that gains less than a chance of so many deviations is not moved.
  Agreement of(std::size_t member, double sigmas) const;

 private:
  MemberColumns columns_, half_columns_;
  std::vector<PartSums> halves_, turns_, rates_;
};

}  // namespace twinrate
