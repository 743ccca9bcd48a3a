// The matrix filter's steps. The file is compiled twice; MATRIX_STEPS names the table. A number
// type for each object keeps the template instances of the two objects separate.
#include "firmware/cortex_m3/image/count_steps.hpp"

namespace twinrate::m3 {
namespace {

struct Number : Plain32 {};
matrix::Filter<Number> filter;
static_assert(sizeof filter == sizeof(matrix::Filter<Plain32>));

void load(StepContext* c) {
  __builtin_memcpy(&filter, &c->matrix, sizeof filter);
}
void F(StepContext*) {
  matrix::jacobian(filter);
}
void P_prior(StepContext*) {
  matrix::propagate(filter);
}
void K(StepContext*) {
  matrix::gain(filter);
}
void P(StepContext* c) {
  matrix::posterior(filter, c->v32.c, c->clamps);
}
void x_prior(StepContext*) {
  matrix::predict(filter);
}
void x(StepContext*) {
  matrix::correct(filter);
}

}  // namespace

extern const MatrixSteps MATRIX_STEPS;
const MatrixSteps MATRIX_STEPS = {load, F, P_prior, K, P, x_prior, x};

}  // namespace twinrate::m3
