#include "loop/closed_floquet.hpp"

#include <cmath>
#include <complex>
#include <numeric>

#include "controller/scaled_tuning.hpp"
#include "core/field_list.hpp"
#include "estimator/gain_frame.hpp"
#include "estimator/make_filter.hpp"
#include "model/discretise.hpp"
#include "model/linear_algebra.hpp"
#include "model/math.hpp"

namespace twinrate {

using Eigen::VectorXd;

// u_dq in the axes of the estimate from the estimate and the measured currents; `memory` in and out.
struct ControlLaw {
  virtual ~ControlLaw() = default;
  virtual int n_memory() const = 0;
  virtual int divider() const { return 1; }
  virtual Vec2 voltage(const Estimate& e, const Vec2& i_dq_measured, double omega_m_ref,
                       std::int64_t tick, Eigen::Ref<VectorXd> memory) const = 0;
  double advance_s = 0;
};

namespace {

constexpr double kDifference = 1e-6;
constexpr int kSettleSteps = 30;
constexpr double kSettled = 1e-9;  // relative change over a tick
constexpr int kPlantSteps = 2;     // Runge-Kutta steps in T_s
constexpr int kNewtonSteps = 3;
constexpr int kGainsUnderLoad = 2;
constexpr double kPeriodic = 1e-6;  // relative change over a period

// controller/foc.hpp without limits. Memory: integrals of speed, d and q, and the held I_s.
struct FocLaw final : ControlLaw {
  FocLaw(const DriveConfig& c, const FocParameters& p)
      : m(c.machine),
        parameters(p),
        speed(speed_pi(kTwoPi * p.speed_bandwidth, m.J, m.torque_constant())),
        d(current_pi(kTwoPi * p.current_bandwidth, m.R_s, m.L_d)),
        q(current_pi(kTwoPi * p.current_bandwidth, m.R_s, m.L_q)),
        i_d_ref(c.reference.i_d_A.at(0)),
        T_s(c.T_s()) {}
  int n_memory() const override { return 4; }
  int divider() const override { return parameters.speed_divider; }
  Vec2 voltage(const Estimate& e, const Vec2& i_dq, double omega_m_ref, std::int64_t tick,
               Eigen::Ref<VectorXd> x) const override {
    if (tick % divider() == 0) {
      const double error = omega_m_ref - e.omega_m;
      x[3] = speed.K_p * error + x[0];
      x[0] += divider() * T_s * speed.K_i * error;
    }
    Vec2 wanted(0, x[3]);
    if (parameters.current_angle == CurrentAngle::kMtpa) wanted = mtpa(m, x[3]);
    wanted[0] += i_d_ref;
    const Vec2 error = wanted - i_dq;
    const double omega_e = m.n_p * e.omega_m;
    Vec2 u(d.K_p * error[0] + x[1], q.K_p * error[1] + x[2]);
    if (parameters.decoupling)
      u += Vec2(-omega_e * m.L_q * i_dq[1], omega_e * (m.L_d * i_dq[0] + m.psi_f));
    x[1] += T_s * d.K_i * error[0];
    x[2] += T_s * q.K_i * error[1];
    return u;
  }

  MachineParameters m;
  FocParameters parameters;
  PiGains speed, d, q;
  double i_d_ref, T_s;
};

// controller/lqr.hpp without limits. Memory: p_id, p_omega.
struct LqrLaw final : ControlLaw {
  LqrLaw(const DriveConfig& c, const LqrDesign& design)
      : m(c.machine),
        K_d(design.d.K.transpose()),
        K_q(design.q.K.transpose()),
        K_pp(design.K_pp),
        K_ff(c.controller.compensation_at(0) == Compensation::kPaper ? design.K_ff : 0),
        lead_s(m.L_q / (m.R_s + K_pp * K_q[0]) + (c.plant.delay_samples + 0.5) * c.T_s()),
        i_d_ref(c.reference.i_d_A.at(0)),
        T_s(c.T_s()) {}
  int n_memory() const override { return 2; }
  Vec2 voltage(const Estimate& e, const Vec2&, double omega_m_ref, std::int64_t,
               Eigen::Ref<VectorXd> p) const override {
    const Vec2 i = e.i_dq;
    p[0] += T_s * (i[0] - i_d_ref);
    p[1] += T_s * (e.omega_m - omega_m_ref);
    const double omega_e = m.n_p * e.omega_m;
    const double u_d = -K_d.dot(Vec2(i[0], p[0])) - omega_e * m.L_q * i[1] / K_pp;
    const double u_q = -K_q.dot(Vec3(i[1], e.omega_m, p[1])) -
                       K_ff * (e.T_load + lead_s * e.dT_load_dt) +
                       omega_e * (m.L_d * i[0] + m.psi_f) / K_pp;
    return K_pp * Vec2(u_d, u_q);
  }

  MachineParameters m;
  Vec2 K_d;
  Vec3 K_q;
  double K_pp, K_ff, lead_s, i_d_ref, T_s;
};

std::shared_ptr<const ControlLaw> law_of(Config& config) {
  const DriveConfig& c = config.drive();
  const std::string table = "controller." + c.controller.kind;
  std::shared_ptr<ControlLaw> law;
  if (c.controller.kind == "foc") {
    FocParameters p;
    scale(p, c);
    config.read_table(table, [&](FieldVisitor& f) { p.fields(f); });
    law = std::make_shared<FocLaw>(c, p);
  } else if (c.controller.kind == "lqr") {
    LqrParameters p;
    scale(p, c);
    config.read_table(table, [&](FieldVisitor& f) { p.fields(f); });
    const LqrDesign design = design_lqr(c.machine, c.inverter.v_dc, c.T_s(), p.design);
    if (design.d.complaints.empty() && design.q.complaints.empty())
      law = std::make_shared<LqrLaw>(c, design);
  }
  if (law) law->advance_s = (c.plant.delay_samples + 0.5) * c.T_s();
  return law;
}

// [i_d, i_q, omega_m, theta_e] over T under a voltage that is constant in stator axes.
Eigen::Vector4d machine_step(const MachineParameters& m, const Eigen::Vector4d& x, const Vec2& u,
                             double T_load, double T) {
  const auto rate = [&](const Eigen::Vector4d& s) -> Eigen::Vector4d {
    const Vec2 u_dq = park(u, s[3]);
    const double omega_e = m.n_p * s[2];
    return {(u_dq[0] - m.R_s * s[0] + omega_e * m.L_q * s[1]) / m.L_d,
            (u_dq[1] - m.R_s * s[1] - omega_e * (m.L_d * s[0] + m.psi_f)) / m.L_q,
            (m.torque(s[0], s[1]) - m.B * s[2] - T_load) / m.J, omega_e};
  };
  Eigen::Vector4d y = x;
  for (int i = 0; i < kPlantSteps; ++i) y = rk4_step<Eigen::Vector4d>(rate, y, T / kPlantSteps);
  return y;
}

bool processes_an_angle(const Filter& filter) {
  return filter.kind() == "active_flux" || filter.kind() == "backemf_printed";
}

bool holds_an_angle(const Filter& filter) {
  return filter.kind() == "ekf_sensorless" || filter.kind() == "ekf_joint" ||
         filter.kind() == "dq_ekf";
}

// Leading pairs of states in stationary axes. A gain of active_flux is the same at every angle.
int stationary_pairs(const Filter& filter) {
  return processes_an_angle(filter) ? 2 : filter.turning_pairs();
}

// The estimate seen from axes that lie `angle` ahead.
template <class States>
void turn_back(const Filter& filter, double angle, States&& x_hat) {
  for (int i = 0; i < 2 * stationary_pairs(filter); i += 2)
    x_hat.template segment<2>(i) = rotate(Vec2(x_hat.template segment<2>(i)), -angle);
  if (holds_an_angle(filter)) x_hat[3] = wrap_pi(x_hat[3] - angle);
}

// K R(angle) = R(angle) K for each pair of states.
bool is_isotropic(const Gain& gain, int pairs) {
  Gain turned = gain;
  GainFrame(pairs, kPi / 5).turn_gain(turned);
  return (turned.K - gain.K).norm() <= 1e-9 * gain.K.norm();
}

bool is_covered(const Steady& steady, const DriveConfig& d) {
  const Filter& filter = *steady.filter;
  if (!filter.steady_state(0) || d.controller.angle_source != AngleSource::kEstimate) return false;
  return !processes_an_angle(filter) ||
         is_isotropic(rotor_gains_of_period(steady, 1).front(), stationary_pairs(filter));
}

// Control ticks of one interval of the filter's angle and speed processing.
int divider_of(Config& config) {
  const DriveConfig& d = config.drive();
  const auto builder = filter_builder(d.estimator.kind, d);
  const auto fields = [&](FieldVisitor& f) { builder->fields(f); };
  config.read_table("estimator." + d.estimator.kind, fields);
  for (const FieldRow& row : list_fields(fields))
    if (row.key == "divider") return static_cast<int>(row.value);
  return 1;
}

}  // namespace

std::optional<ClosedFloquet> ClosedFloquet::of(Config& config, double omega_e,
                                               std::optional<GainPolicy> policy) {
  const DriveConfig& d = config.drive();
  return of(config, {make_filter(config), policy.value_or(d.gain.policy), omega_e / d.machine.n_p,
                     omega_e, d.T_s(), d.gain.speed_span / d.machine.n_p});
}

std::optional<ClosedFloquet> ClosedFloquet::of(Config& config, const Steady& steady,
                                               std::optional<double> T_load) {
  const DriveConfig& d = config.drive();
  ClosedFloquet c;
  c.steady_ = steady;
  if (!is_covered(c.steady_, d)) return {};
  c.law_ = law_of(config);
  if (!c.law_) return {};
  c.machine_ = d.machine;
  c.T_load_ =
      T_load.value_or(d.load.T_load_Nm.steps().empty() ? 0 : d.load.T_load_Nm.steps().back().value);
  c.delay_ = d.plant.delay_samples;
  c.n_x_ = steady.filter->steady_state(0)->n_x;
  if (processes_an_angle(*steady.filter)) {
    c.n_angle_ = 4;
    c.divider_ = divider_of(config);
  }
  if (!c.settle() || !c.settle_under_load()) return {};
  return c;
}

Eigen::Index ClosedFloquet::gain_at() const {
  return memory_at() + law_->n_memory();
}

int ClosedFloquet::ticks_of_period(int n) const {
  return std::lcm(n, std::lcm(law_->divider(), divider_));
}

FastState ClosedFloquet::memory_of(const VectorXd& z, std::int64_t k) const {
  FastState state;
  state.x_hat.head(n_x_) = z.segment(x_at(), n_x_);
  state.i_dq_prev = z.head<2>();
  if (n_angle_ == 0) return state;
  const auto angle = z.segment<4>(angle_at());
  state.emf_angle = {.ticks = static_cast<int>(k % divider_),
                     .theta_emf = angle[0],
                     .theta_e = angle[1],
                     .omega_e = angle[2],
                     .omega_f = angle[3]};
  return state;
}

void ClosedFloquet::remember(const FastState& state, double turned, VectorXd& z) const {
  auto x_hat = z.segment(x_at(), n_x_);
  x_hat = state.x_hat.head(n_x_);
  turn_back(*steady_.filter, turned, x_hat);
  if (n_angle_ == 0) return;
  const EmfAngle& a = state.emf_angle;
  z.segment<4>(angle_at()) << wrap_pi(a.theta_emf - turned), wrap_pi(a.theta_e - turned), a.omega_e,
      a.omega_f;
}

// theta_e_hat less the angle of the rotor, for a state in the axes of the rotor.
double ClosedFloquet::angle_error(const VectorXd& z, double ticks_ahead) const {
  const FastState state = memory_of(z, 0);
  const Estimate e = steady_.filter->estimate_of(state, {.signals = kPhaseCurrents | kVoltage});
  const double nominal = ticks_ahead * steady_.T_s * steady_.omega_e;
  return wrap_pi(steady_.filter->ahead(e, ticks_ahead).theta_e - nominal);
}

// The angle by which the gain in use lies off the one of a snapshot on the true rotor.
double ClosedFloquet::gain_error(const VectorXd& z) const {
  const GainPolicy p = steady_.policy;
  const bool held =
      p == GainPolicy::kPaper || p == GainPolicy::kImmediate || p == GainPolicy::kExtrapolate;
  return held ? z[gain_at()] : angle_error(z, 0);
}

// After the tick `i` of a period of n: the angle errors of the snapshots.
void ClosedFloquet::take_snapshot(int i, int n, double turned, VectorXd& z) const {
  double& in_use = z[gain_at()];
  double& waiting = z[gain_at() + 1];
  const double off = turned - steady_.omega_e * steady_.T_s;
  in_use -= off;
  waiting -= off;
  if (steady_.policy == GainPolicy::kImmediate) {
    if (i == n - 1) in_use = angle_error(z, 0);
    return;
  }
  const double lead = steady_.policy == GainPolicy::kExtrapolate ? 1.5 * (n - 1) : 0;
  if (i == 0) waiting = angle_error(z, lead);
  if (i == n - 1) in_use = waiting;
}

VectorXd ClosedFloquet::tick(const VectorXd& z, const Gain& gain, std::int64_t k, int n,
                             Gain& used) const {
  const Filter& filter = *steady_.filter;
  const double T_s = steady_.T_s;
  VectorXd next = z;
  copy_gain(used, gain);
  GainFrame(filter.turning_pairs(), gain_error(z)).turn_gain(used);
  // The sample of t_k, the rotor at angle 0.
  Measurement m{.signals = kPhaseCurrents | kVoltage | kPosition | kSpeed};
  m.i_abc = inverse_clarke(Vec2(z.head<2>()));
  m.omega_m = z[2];
  FastState state = memory_of(z, k);
  const Estimate e = filter.estimate_of(state, m);
  const Vec2 u_dq = law_->voltage(e, park(Vec2(z.head<2>()), e.theta_e), steady_.omega_m, k,
                                  next.segment(memory_at(), law_->n_memory()));
  const Vec2 u_new = inverse_park(u_dq, e.theta_e + law_->advance_s * machine_.n_p * e.omega_m);
  const Vec2 u = delay_ > 0 ? Vec2(z.segment<2>(x_at() - 2)) : u_new;
  // The machine, and the sample of t_{k+1}.
  const Eigen::Vector4d x = machine_step(machine_, {z[0], z[1], z[2], 0}, u, T_load_, T_s);
  const double turned = x[3];
  m.theta_m = turned / machine_.n_p;
  m.omega_m = m.theta_m / T_s;  // as an encoder gives it
  m.i_abc = inverse_clarke(inverse_park(x.head<2>(), turned));
  m.u_alphabeta = u;
  filter.fast_step(state, m, used);
  // Into the axes of the rotor at t_{k+1}.
  next.head<3>() = x.head<3>();
  for (int i = delay_ - 1; i > 0; --i)
    next.segment<2>(3 + 2 * i) = rotate(Vec2(z.segment<2>(3 + 2 * (i - 1))), -turned);
  if (delay_ > 0) next.segment<2>(3) = rotate(u_new, -turned);
  remember(state, turned, next);
  take_snapshot(static_cast<int>(k % n), n, turned, next);
  return next;
}

// The orbit with a gain every tick, by Newton's method from the machine at its load: a fixed point
// unless the filter divides its ticks. The integrators of the controller enter the equations linearly:
// they may start at zero.
bool ClosedFloquet::settle() {
  const Filter& filter = *steady_.filter;
  const Gain gain = rotor_gains_of_period(steady_, 1).front();
  at_ = VectorXd::Zero(gain_at() + 2);
  const double i_q = (T_load_ + machine_.B * steady_.omega_m) / machine_.torque_constant();
  at_.head<3>() << 0, i_q, steady_.omega_m;
  const Vec2 u(-steady_.omega_e * machine_.L_q * i_q,
               machine_.R_s * i_q + steady_.omega_e * machine_.psi_f);
  for (int i = 0; i < delay_; ++i) at_.segment<2>(3 + 2 * i) = u;
  at_.segment(x_at(), n_x_) = filter.steady_state(steady_.omega_m)->x_hat.head(n_x_);
  if (n_angle_ > 0) at_.segment<2>(angle_at() + 2).setConstant(steady_.omega_e);
  const Eigen::MatrixXd I = Eigen::MatrixXd::Identity(at_.size(), at_.size());
  const int ticks = divider_ > 1 ? ticks_of_period(1) : 1;
  for (int step = 0; step < kSettleSteps; ++step) {
    VectorXd end = at_;
    const Eigen::MatrixXd Phi = transition({gain}, ticks, end);
    const VectorXd off = end - at_;
    if (!off.allFinite()) return false;
    if (off.norm() <= kSettled * at_.norm()) break;
    at_ += linear::solve(I - Phi, off);
  }
  return std::abs(at_[2] - steady_.omega_m) < 0.01 * std::abs(steady_.omega_m) &&
         std::abs(angle_error(at_, 0)) < kPi / 4;
}

// The gain of a filter depends on its currents: it is that of the orbit, and the orbit that of the gain.
bool ClosedFloquet::settle_under_load() {
  const Filter& filter = *steady_.filter;
  if (T_load_ == 0 || processes_an_angle(filter)) return true;
  for (int i = 0; i < kGainsUnderLoad; ++i) {
    FastState state = memory_of(at_, 0);
    const Measurement m{.signals = kPhaseCurrents | kVoltage | kPosition | kSpeed};
    turn_back(filter, filter.estimate_of(state, m).theta_e, state.x_hat);
    steady_.at = filter.estimate_of(state, m);
    steady_.found = std::make_shared<std::map<int, Gain>>();
    if (!settle()) return false;
  }
  return true;
}

Eigen::MatrixXd ClosedFloquet::derivative(const VectorXd& z, const Gain& gain, std::int64_t k,
                                          int n, Gain& used) const {
  Eigen::MatrixXd J(z.size(), z.size());
  VectorXd beside = z;
  for (Eigen::Index col = 0; col < z.size(); ++col) {
    beside[col] = z[col] + kDifference;
    J.col(col) = tick(beside, gain, k, n, used);
    beside[col] = z[col] - kDifference;
    J.col(col) = (J.col(col) - tick(beside, gain, k, n, used)) / (2 * kDifference);
    beside[col] = z[col];
  }
  return J;
}

Eigen::MatrixXd ClosedFloquet::transition(const std::vector<Gain>& gains, int ticks,
                                          VectorXd& z) const {
  const int n = static_cast<int>(gains.size());
  Eigen::MatrixXd Phi = Eigen::MatrixXd::Identity(z.size(), z.size());
  Gain used = gains.front();
  for (int k = 0; k < ticks; ++k) {
    const Gain& gain = gains[static_cast<std::size_t>(k % n)];
    Phi = (derivative(z, gain, k, n, used) * Phi).eval();
    z = tick(z, gain, k, n, used);
  }
  return Phi;
}

// The matrix of one period along its own periodic orbit, which Newton's method finds from the fixed
// point: with a stale gain and a biased prediction the innovation is not zero.
Eigen::MatrixXd ClosedFloquet::period(int n) const {
  const std::vector<Gain> gains = rotor_gains_of_period(steady_, n);
  const Eigen::MatrixXd I = Eigen::MatrixXd::Identity(at_.size(), at_.size());
  VectorXd start = at_;
  Eigen::MatrixXd Phi;
  for (int iteration = 0; iteration < kNewtonSteps; ++iteration) {
    VectorXd z = start;
    Phi = transition(gains, ticks_of_period(n), z);
    if ((z - start).norm() <= kPeriodic * z.norm()) break;
    start += linear::solve(I - Phi, z - start);
  }
  return Phi;
}

double ClosedFloquet::spectral_radius(int n) const {
  const int periods = ticks_of_period(n) / n;
  return math::pow(linear::eigenvalues(period(n)).cwiseAbs().maxCoeff(), 1.0 / periods);
}

double ClosedFloquet::frequency_Hz(int n) const {
  const Eigen::VectorXcd values = linear::eigenvalues(period(n));
  Eigen::Index largest = 0;
  values.cwiseAbs().maxCoeff(&largest);
  return std::abs(math::arg(values[largest])) / (kTwoPi * ticks_of_period(n) * steady_.T_s);
}

int ClosedFloquet::n_max_by_bisection(int limit) const {
  if (spectral_radius(limit) < 1) return limit;
  if (!(spectral_radius(1) < 1)) return 0;
  int held = 1, lost = limit;
  while (lost - held > 1) {
    int n = (held + lost) / 2;
    if (n - n % law_->divider() > held) n -= n % law_->divider();  // a period of n ticks alone
    (spectral_radius(n) < 1 ? held : lost) = n;
  }
  return held;
}

int ClosedFloquet::n_max(int limit) const {
  // A gain that turns with the rotor, or is the same at every angle, does not age by rotation.
  // Usually every n keeps synchronism, or every n up to a limit.
  const bool ageless = turns_gain(steady_.policy) || steady_.policy == GainPolicy::kPropagated ||
                       steady_.filter->turning_pairs() == 0;
  if (ageless) return n_max_by_bisection(limit);
  for (int n = 1; n <= limit; ++n)
    if (!(spectral_radius(n) < 1)) return n - 1;
  return limit;
}

}  // namespace twinrate
