// Agreement of the parts of a record about an effect.
//
// The residual is taken as linear in the coefficients of the effects, with the columns at the fit.
// The sums of the products of these columns over a part give the least-squares coefficients of that
// part. They also give the error that the coefficients of another part leave there, with the
// coefficients of the other effects fitted again.
#pragma once
#include "trace/fit.hpp"

namespace twinrate {

// The columns of the fitted effects. An effect without coefficients has one column, its whole
// contribution, with coefficient 1.
struct MemberColumns {
  std::vector<Sampled> x;
  std::vector<std::size_t> member;
  Eigen::VectorXd value;  // in the fit
  Sampled declared;       // residual with all coefficients 0
};
// `in_sensors`: whitened by Chain::in_sensors.
MemberColumns member_columns(const Chain& chain, const Members& members, bool in_sensors);

// Sums of products over the rows of a part: columns with columns, and columns with the residual of
// the declared model. No noise is subtracted. `noise`: its share of the diagonal of A.
struct PartSums {
  Eigen::MatrixXd A;
  Eigen::VectorXd b, noise;
  double energy = 0, count = 0;

  PartSums(const MemberColumns& columns, const Rows& rows);
  // Of given rows: y = x beta + error.
  PartSums(const Eigen::MatrixXd& x, const Eigen::VectorXd& y);
  PartSums operator+(const PartSums& other) const;
};

struct Agreement {
  double kept = 1;           // smallest share of a part's own gain that foreign coefficients keep
  int compared = 0;          // number of comparisons
  const char* between = "";  // the two parts with the smallest share
  double size_ratio = 1;     // predicted size at half the rate over that at the record's rate
};

// The least-squares coefficients of a part, with the coefficients of `held` given. No noise is
// subtracted.
struct PartAnswer {
  Eigen::VectorXd beta;
  double energy = 0;  // not reduced by a share of noise
};
PartAnswer best_answer(const PartSums& part, const std::vector<char>& held,
                       const Eigen::VectorXd& given);
// Fits `from`, applies the coefficients of the claim to `on`, and adds to `out` the share of the
// gain on `on` that they keep. `own`: the coefficients of the claim. `least`: a gain below this
// multiple of the mean square of the error does not count. A part in which noise makes most of the
// claim's columns has no coefficients of the claim to compare: a constant speed says nothing of an
// inertia.
void compare_parts(const PartSums& from, const PartSums& on, const std::vector<char>& own,
                   double least, const char* between, Agreement& out);

// Projection of the prediction of `other` on the prediction of `one`, over the square of the
// latter. `A`: products of the columns. The ratio stays meaningful if the data determine only the
// difference of some coefficients.
double predicted_ratio(const Eigen::MatrixXd& A, const Eigen::VectorXd& one,
                       const Eigen::VectorXd& other);

class Parts {
 public:
  // `half_rate`: null if the record has no chain at half the rate.
  Parts(const Chain& whole, const Members& members, const Chain* half_rate);
  // `sigmas`: a gain counts if it exceeds that of chance by this many standard deviations.
  Agreement of(std::size_t member, double sigmas) const;

 private:
  MemberColumns columns_;
  std::vector<PartSums> halves_, turns_, rates_;
};

}  // namespace twinrate
