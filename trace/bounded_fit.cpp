// The part `ceres`.
#include "trace/bounded_fit.hpp"

#include <ceres/ceres.h>

#include "core/load_part.hpp"

namespace twinrate {
namespace {

struct Residual {
  const BoundedProblem* problem;
  bool operator()(double const* const* x, double* residual) const {
    problem->residual(x[0], residual);
    return true;
  }
};

}  // namespace
}  // namespace twinrate

TWINRATE_PART void twinrate_part(const twinrate::BoundedProblem& p, std::vector<double>& x,
                                 twinrate::BoundedFit& fit) {
  using twinrate::Residual;
  const std::size_t parameters = x.size();
  auto* cost =
      new ceres::DynamicNumericDiffCostFunction<Residual, ceres::CENTRAL>(new Residual{&p});
  cost->AddParameterBlock(static_cast<int>(parameters));
  cost->SetNumResiduals(p.residuals);
  ceres::Problem problem;  // takes the cost
  problem.AddResidualBlock(cost, nullptr, x.data());
  for (std::size_t j = 0; j < parameters; ++j) {
    problem.SetParameterLowerBound(x.data(), static_cast<int>(j), p.lo[j]);
    problem.SetParameterUpperBound(x.data(), static_cast<int>(j), p.hi[j]);
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  options.logging_type = ceres::SILENT;
  options.max_num_iterations = p.max_iterations;
  options.function_tolerance = p.function_tolerance;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  fit.cost = summary.final_cost;

  ceres::Covariance::Options of_covariance;
  of_covariance.algorithm_type = ceres::DENSE_SVD;
  of_covariance.null_space_rank = -1;  // a parameter that the points do not determine has none
  ceres::Covariance covariance(of_covariance);
  const std::vector<std::pair<const double*, const double*>> blocks{{x.data(), x.data()}};
  fit.covariance.resize(parameters * parameters);
  if (!covariance.Compute(blocks, &problem) ||
      !covariance.GetCovarianceBlock(x.data(), x.data(), fit.covariance.data()))
    fit.covariance.clear();
}
