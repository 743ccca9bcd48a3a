#include "firmware/cortex_m3/image/count_steps.hpp"

namespace twinrate::m3 {
namespace {

using N32 = Plain32;
using N16 = Plain16;

void empty(StepContext*) {}

void unit_vector_step(StepContext* c) {
  c->at_out = unit_vector<N32>(c->x.theta);
}

template <class N, class Q, VariantContext<N, Q> StepContext::*kOf>
struct Of {
  static VariantContext<N, Q>& v(StepContext* c) { return c->*kOf; }
  static void F(StepContext* c) { v(c).F_out = jacobian<N, Q>(v(c).c, c->x.omega, c->at); }
  static void P_prior(StepContext* c) {
    v(c).P_prior_out = propagate<N, Q>(v(c).c, v(c).F, v(c).P);
  }
  static void K(StepContext* c) { v(c).K_out = gain<N, Q>(v(c).c, v(c).P_prior); }
  static void P(StepContext* c) {
    v(c).P_out = posterior<N, Q>(v(c).c, v(c).P_prior, v(c).K, v(c).clamps);
  }
  static void x(StepContext* c) {
    const Pair<N32> innov = innovation<N32>(c->x_prior, c->y);
    c->x_out = correct<N, Q>(c->step, c->x_prior, v(c).K, innov, c->clamps);
  }
  static void background(StepContext* c) {
    const auto F = jacobian<N, Q>(v(c).c, c->x.omega, c->at);
    const auto P_prior = propagate<N, Q>(v(c).c, F, v(c).P);
    v(c).K_out = gain<N, Q>(v(c).c, P_prior);
    v(c).P_out = posterior<N, Q>(v(c).c, P_prior, v(c).K_out, v(c).clamps);
  }
  static void fast(StepContext* c) {
    const State<N32> prior = predict<N32>(c->step, c->x, c->at, c->u);
    const Pair<N32> innov = innovation<N32>(prior, c->y);
    c->x_out = correct<N, Q>(c->step, prior, v(c).K, innov, c->clamps);
    c->at_out = unit_vector<N32>(c->x_out.theta);
  }
};
using In32 = Of<N32, Format32, &StepContext::v32>;
using In16 = Of<N16, Format16, &StepContext::v16>;

void x_prior(StepContext* c) {
  c->x_prior_out = predict<N32>(c->step, c->x, c->at, c->u);
}

void fast_rotate(StepContext* c) {
  const State<N32> prior = predict<N32>(c->step, c->x, c->at, c->u);
  const Pair<N32> innov = innovation<N32>(prior, c->y);
  const UnitVector<N32> by = unit_vector<N32>(c->x.theta - 0x10000000u);
  c->x_out = correct_turned<N32, Format32>(c->step, prior, c->v32.K, by, innov, c->clamps);
  c->at_out = unit_vector<N32>(c->x_out.theta);
}
void fast_scheduled(StepContext* c) {
  const State<N32> prior = predict<N32>(c->step, c->x, c->at, c->u);
  const Pair<N32> innov = innovation<N32>(prior, c->y);
  c->x_out = correct_scheduled<N32>(c->step, prior, c->settings->schedule, c->x.omega, c->at, innov,
                                    c->clamps);
  c->at_out = unit_vector<N32>(c->x_out.theta);
}

template <class N>
void set_zero(Covariance<N>& P, const CovarianceConstants& c) {
  P = {};
  P.m00 = static_cast<typename N::Cell>(c.P0[0]);
  P.m11 = static_cast<typename N::Cell>(c.P0[1]);
  P.m22 = static_cast<typename N::Cell>(c.P0[2]);
  P.m33 = static_cast<typename N::Cell>(c.P0[3]);
}

// Computes the gains of the next tick and the inputs of the separate steps.
template <class N, class Q>
void advance(VariantContext<N, Q>& v, const State<N32>& x, const UnitVector<N32>& at) {
  v.F = jacobian<N, Q>(v.c, x.omega, at);
  v.P_prior = propagate<N, Q>(v.c, v.F, v.P);
  v.K = gain<N, Q>(v.c, v.P_prior);
  v.P = posterior<N, Q>(v.c, v.P_prior, v.K, v.clamps);
}

// Copies the same tick to the matrix filter.
void mirror(StepContext& c) {
  auto& f = c.matrix;
  const Covariance<N32>& P = c.v32.P;
  const int32_t full[16] = {P.m00, P.m01, P.m02, P.m03, P.m01, P.m11, P.m12, P.m13,
                            P.m02, P.m12, P.m22, P.m23, P.m03, P.m13, P.m23, P.m33};
  for (int i = 0; i < 16; ++i) f.P[i] = full[i];
  f.at = c.at;
  f.x[0] = c.x.i_alpha;
  f.x[1] = c.x.i_beta;
  f.x[2] = c.x.omega;
  f.x[3] = static_cast<int32_t>(c.x.theta);
  f.u[0] = c.u.alpha;
  f.u[1] = c.u.beta;
  f.y[0] = c.y.alpha;
  f.y[1] = c.y.beta;
  matrix_steps_O0.load(&c);
  matrix_steps_O2.load(&c);
}

}  // namespace

const NamedStep* steps() {
  static const NamedStep list[] = {
      {"empty", empty},
      {"sin_cos", unit_vector_step},
      {"matrix_O0.F", matrix_steps_O0.F},
      {"matrix_O0.P_prior", matrix_steps_O0.P_prior},
      {"matrix_O0.K", matrix_steps_O0.K},
      {"matrix_O0.P", matrix_steps_O0.P},
      {"matrix_O0.x_prior", matrix_steps_O0.x_prior},
      {"matrix_O0.x", matrix_steps_O0.x},
      {"matrix_O2.F", matrix_steps_O2.F},
      {"matrix_O2.P_prior", matrix_steps_O2.P_prior},
      {"matrix_O2.K", matrix_steps_O2.K},
      {"matrix_O2.P", matrix_steps_O2.P},
      {"matrix_O2.x_prior", matrix_steps_O2.x_prior},
      {"matrix_O2.x", matrix_steps_O2.x},
      {"simplified.F", In32::F},
      {"simplified.P_prior", In32::P_prior},
      {"simplified.K", In32::K},
      {"simplified.P", In32::P},
      {"simplified.x_prior", x_prior},
      {"simplified.x", In32::x},
      {"simplified.fast", In32::fast},
      {"simplified.background", In32::background},
      {"simplified.fast_rotate", fast_rotate},
      {"scheduled.fast", fast_scheduled},
      {"bits16.F", In16::F},
      {"bits16.P_prior", In16::P_prior},
      {"bits16.K", In16::K},
      {"bits16.P", In16::P},
      {"bits16.fast", In16::fast},
      {"bits16.background", In16::background},
  };
  static_assert(sizeof list / sizeof list[0] == kSteps);
  return list;
}

void start(StepContext& c, const Settings& settings) {
  c.settings = &settings;
  c.step = settings.step;
  c.v32.c = settings.covariance;
  c.v16.c = settings.covariance16;
  set_zero<N32>(c.v32.P, c.v32.c);
  set_zero<N16>(c.v16.P, c.v16.c);
  matrix::start(c.matrix, c.step, c.v32.c);
  c.x = {0, 0, settings.omega_start, settings.theta_start};
  c.at = unit_vector<N32>(c.x.theta);
}

void run_tick(StepContext& c, const Sample& sample) {
  c.u = {sample.u_alpha, sample.u_beta};
  c.y = {sample.i_alpha, sample.i_beta};
  const State<N32> prior = predict<N32>(c.step, c.x, c.at, c.u);
  c.x = correct<N32, Format32>(c.step, prior, c.v32.K, innovation<N32>(prior, c.y), c.clamps);
  c.at = unit_vector<N32>(c.x.theta);
  advance<N32, Format32>(c.v32, c.x, c.at);
  advance<N16, Format16>(c.v16, c.x, c.at);
  c.x_prior = predict<N32>(c.step, c.x, c.at, c.u);
  mirror(c);
}

}  // namespace twinrate::m3
