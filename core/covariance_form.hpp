// The forms of the covariance update (15); the equations are in estimator/covariance.hpp.
//
// "sequential" processes one output after the other, for diagonal R. It equals the others in exact
// arithmetic and is accurate if R is far smaller than P^-, because it needs no determinant. "auto"
// chooses it in that case, and Joseph otherwise.
#pragma once

namespace twinrate {

enum class CovarianceForm : int { kJoseph = 0, kPaper = 1, kSequential = 2, kAuto = 3 };
inline constexpr const char* kCovarianceFormNames[] = {"joseph", "paper", "sequential", "auto"};

// R_min: smallest diagonal entry of R; P_max: largest variance of a measured state.
inline CovarianceForm resolve(CovarianceForm form, double R_min, double P_max) {
  if (form != CovarianceForm::kAuto) return form;
  return R_min < 1e-6 * P_max ? CovarianceForm::kSequential : CovarianceForm::kJoseph;
}

}  // namespace twinrate
