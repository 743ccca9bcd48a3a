// The steps that count_image.cpp measures, each a function on one context. No step overwrites an
// input of another step, so all steps start from the same tick.
#pragma once
#include "firmware/cortex_m3/ekf_matrix.hpp"
#include "firmware/cortex_m3/two_rate.hpp"

namespace twinrate::m3 {

// One variant's inputs and results.
template <class N, class Q>
struct VariantContext {
  CovarianceConstants c;
  Covariance<N> P, P_prior, P_out, P_prior_out;
  Gain<N> K, K_out;
  Jacobian<N> F, F_out;
  Clamps clamps;
};

struct StepContext {
  const Settings* settings;
  StepConstants step;
  State<Plain32> x, x_prior, x_out, x_prior_out;
  UnitVector<Plain32> at, at_out;
  Pair<Plain32> u, y, innov;
  Clamps clamps;
  VariantContext<Plain32, Format32> v32;
  VariantContext<Plain16, Format16> v16;
  matrix::Filter<Plain32> matrix;
};

using Step = void (*)(StepContext*);
struct NamedStep {
  const char* name;
  Step run;
};
inline constexpr int kSteps = 30;
const NamedStep* steps();

// Of matrix_steps.cpp, compiled without and with optimisation.
struct MatrixSteps {
  Step load;  // copies the context; not measured
  Step F, P_prior, K, P, x_prior, x;
};
extern const MatrixSteps matrix_steps_O0, matrix_steps_O2;

void start(StepContext& c, const Settings& settings);
// Runs the full filter (n = 1) over one sample and leaves the inputs of the next steps.
void run_tick(StepContext& c, const Sample& sample);

}  // namespace twinrate::m3
