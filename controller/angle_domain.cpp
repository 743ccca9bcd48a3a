#include "controller/angle_domain.hpp"

#include <algorithm>
#include <cmath>

#include "model/frames.hpp"
#include "model/math.hpp"

namespace twinrate {
namespace {

constexpr double kShortestBlock_s = 0.2;  // settling and measuring each take this long at least
constexpr double kSlowest_rad_s = 1e-2;   // below it nothing is learnt: a turn takes ten minutes
constexpr double kLoadStep_rad = 0.02;    // change of the mean error, in angle: a load stepped
constexpr double kPriorVariance = 0.25;   // of kappa about 1
constexpr double kFirstTorque2 = 0.01;    // Nm^2: variance of c_N before anything is learnt
constexpr double kDrift = 1e-4;           // share of P kept alive, so that learning never ends
constexpr double kLowest_Hz = 0.05;

int bin_of(double omega) {
  const double octaves = math::log(std::max(omega / kTwoPi / kLowest_Hz, 1.0)) / std::numbers::ln2;
  return std::min(63, static_cast<int>(std::lround(4 * octaves)));
}

// Of |E|^2 around order N: most orders hold nothing but noise, and of a complex normal number the
// median of the square is ln 2 times its mean.
double local_noise2(const std::array<std::complex<double>, kCompensatedOrders>& E, int N) {
  constexpr int kReach = 10;
  std::array<double, 2 * kReach + 1> square{};
  const int first = std::clamp(N - kReach, 0, kCompensatedOrders - 2 * kReach - 1);
  for (int i = 0; i <= 2 * kReach; ++i)
    square[static_cast<std::size_t>(i)] = std::norm(E[static_cast<std::size_t>(first + i)]);
  std::nth_element(square.begin(), square.begin() + kReach, square.end());
  return square[kReach] / std::numbers::ln2;
}

}  // namespace

void AngleDomainParameters::fields(FieldVisitor& f) {
  f.boolean("learn", learn, "learn during the run; false: use the table as it is");
  f.integer("highest_order", highest_order, 1, kCompensatedOrders,
            "highest order that is compensated, from 1 on");
  f.number("rate", rate, 0.01, 1, "largest fraction of an error that one update removes");
  f.numbers("cos_Nm", cos_Nm, -1e4, 1e4, "table, orders 1 to 60: torque at theta_m = 0");
  f.numbers("sin_Nm", sin_Nm, -1e4, 1e4, "table, orders 1 to 60: torque a quarter period on");
}

std::complex<double> LoopModel::voltage_for_torque(double omega) const {
  const std::complex<double> s(0, omega);
  return (R_s + s * L_q + K_pp * K_iq * math::exp(-s * T_d)) / (K_pp * K_t);
}

std::complex<double> LoopModel::speed_for_torque(double omega) const {
  const std::complex<double> s(0, omega), delay = math::exp(-s * T_d);
  const std::complex<double> Z = R_s + s * L_q + K_pp * K_iq * delay;
  return 1.0 / (J * s + B + K_t * K_pp * delay * (K_omega + K_p / s) / Z);
}

AngleDomain::AngleDomain(const AngleDomainParameters& p, const LoopModel& loop, double T_s)
    : p_(p), loop_(loop), T_s_(T_s) {
  for (std::size_t i = 0; i < c_.size(); ++i) c_[i] = {p.cos_Nm[i], -p.sin_Nm[i]};
  P_.fill(kFirstTorque2);
  kappa_.fill(1.0);
  kappa_variance_.fill(kPriorVariance);
}

AngleDomainParameters AngleDomain::learnt() const {
  AngleDomainParameters p = p_;
  for (std::size_t i = 0; i < c_.size(); ++i) {
    p.cos_Nm[i] = c_[i].real();
    p.sin_Nm[i] = -c_[i].imag();
  }
  return p;
}

AngleDomain::Complex AngleDomain::kappa(double omega) const {
  return kappa_[static_cast<std::size_t>(bin_of(omega))];
}

AngleDomain::Complex AngleDomain::response(int N) const {
  const double omega = N * std::abs(omega_block_);
  const Complex H = loop_.speed_for_torque(omega) * kappa(omega);
  return omega_block_ > 0 ? H : std::conj(H);  // e^{jN theta} turns the other way
}

double AngleDomain::step(double theta_m, double omega_m_ref) {
  if (!running_) {
    running_ = true;
    theta_prev_ = theta_m;
    begin_block(theta_m, omega_m_ref);
    return output(theta_m, omega_m_ref);
  }
  const double error = (theta_m - theta_prev_) / T_s_ - omega_m_ref;
  const double theta_mid = 0.5 * (theta_m + theta_prev_);
  theta_prev_ = theta_m;
  t_phase_ += T_s_;
  if (!p_.learn || std::abs(omega_m_ref) < kSlowest_rad_s || omega_m_ref != omega_block_) {
    have_last_ = have_mean_ = false;
    begin_block(theta_m, omega_m_ref);
    return output(theta_m, omega_m_ref);
  }
  if (measuring_) measure(theta_mid, error);
  const double turns = std::abs(theta_m - theta_begin_) / kTwoPi;
  const double turn_s = kTwoPi / std::abs(omega_m_ref);
  const double turns_needed = std::ceil(kShortestBlock_s / turn_s);
  if (turns >= turns_needed) {
    if (measuring_) {
      end_block();
      begin_block(theta_m, omega_m_ref);
    } else {
      theta_begin_ = theta_m;
      t_phase_ = 0;
      measuring_ = true;
    }
  }
  return output(theta_m, omega_m_ref);
}

void AngleDomain::begin_block(double theta_m, double omega_m_ref) {
  theta_begin_ = theta_m;
  omega_block_ = omega_m_ref;
  t_phase_ = 0;
  measuring_ = false;
  sum_.fill(0.0);
  sum_error_ = time_ = 0;
}

void AngleDomain::measure(double theta_mid, double error) {
  const Complex z1 = math::polar(1.0, -theta_mid);
  Complex z = z1;
  for (Complex& sum : sum_) {
    sum += error * T_s_ * z;
    z *= z1;
  }
  sum_error_ += error * T_s_;
  time_ += T_s_;
}

void AngleDomain::end_block() {
  Orders E;
  for (std::size_t i = 0; i < E.size(); ++i) E[i] = 2 / time_ * sum_[i];
  const double mean = sum_error_ / time_;
  const bool stepped = have_mean_ && std::abs(mean - mean_last_) * time_ > kLoadStep_rad;
  mean_last_ = mean;
  have_mean_ = true;
  if (stepped) {
    have_last_ = false;
    return;
  }
  std::array<double, kCompensatedOrders> noise2;
  for (int i = 0; i < kCompensatedOrders; ++i) {
    double& running = noise2_[static_cast<std::size_t>(i)];
    const double now = local_noise2(E, i);
    running = blocks_ == 0 || now < running ? now : 0.7 * running + 0.3 * now;
    noise2[static_cast<std::size_t>(i)] = running;
  }
  if (have_last_) identify(E, noise2);
  learn(E, noise2);
  ++blocks_;
}

// kappa from the last change of c and its response: Delta E = kappa H_model Delta c.
void AngleDomain::identify(const Orders& E, const std::array<double, kCompensatedOrders>& noise2) {
  for (int N = 1; N <= p_.highest_order; ++N) {
    const auto i = static_cast<std::size_t>(N - 1);
    const double omega = N * std::abs(omega_block_);
    Complex expected = loop_.speed_for_torque(omega);
    if (omega_block_ < 0) expected = std::conj(expected);
    expected *= c_change_[i];
    const double size2 = std::norm(expected);
    if (size2 <= 0) continue;
    Complex seen = (E[i] - E_last_[i]) / expected;
    if (omega_block_ < 0) seen = std::conj(seen);
    const auto bin = static_cast<std::size_t>(bin_of(omega));
    const double variance = 2 * noise2[i] / size2 + 0.01;
    const double k = kappa_variance_[bin] / (kappa_variance_[bin] + variance);
    const Complex kappa = kappa_[bin] + k * (seen - kappa_[bin]);
    kappa_variance_[bin] = (1 - k) * kappa_variance_[bin] + 1e-4;
    kappa_[bin] = math::polar(std::clamp(std::abs(kappa), 0.2, 5.0), math::arg(kappa));
  }
}

void AngleDomain::learn(const Orders& E, const std::array<double, kCompensatedOrders>& noise2) {
  for (int N = 1; N <= p_.highest_order; ++N) {
    const auto i = static_cast<std::size_t>(N - 1);
    const Complex H = response(N);
    const double H2 = std::norm(H), torque_noise2 = noise2[i] / H2;
    const double seen2 = std::norm(E[i]) / H2;
    if (seen2 > 9 * (P_[i] + torque_noise2)) P_[i] = seen2;  // more than was thought possible
    const double k = std::min(p_.rate, P_[i] / (P_[i] + torque_noise2));
    c_change_[i] = -k * E[i] / H;
    c_[i] += c_change_[i];
    P_[i] = (1 - k) * P_[i] + kDrift * torque_noise2;
    E_last_[i] = E[i];
  }
  have_last_ = true;
}

double AngleDomain::output(double theta_m, double omega_m_ref) {
  if (omega_m_ref != g_speed_ || g_[0] == 0.0) {
    g_speed_ = omega_m_ref;
    for (int N = 1; N <= kCompensatedOrders; ++N)
      g_[static_cast<std::size_t>(N - 1)] = loop_.voltage_for_torque(N * omega_m_ref);
  }
  const Complex z1 = math::polar(1.0, theta_m + omega_m_ref * loop_.T_d);
  Complex z = z1;
  double u = 0;
  for (int i = 0; i < p_.highest_order; ++i) {
    u += (g_[static_cast<std::size_t>(i)] * c_[static_cast<std::size_t>(i)] * z).real();
    z *= z1;
  }
  return u;
}

}  // namespace twinrate
