// Proportional-integral controller with back-calculation anti-windup.
//
//   u    = K_p e + x_I
//   x_I' = K_i e + k_awu (u_saturated - u)
#pragma once

namespace twinrate {

struct PiGains {
  double K_p = 0, K_i = 0, k_awu = 0;
};

// Current loop of bandwidth f on R_s, L by pole cancellation; the integral unwinds with the time
// constant of the loop.
//
//   K_p = 2 pi f L,  K_i = 2 pi f R_s,  k_awu = 2 pi f
inline PiGains current_pi(double omega_bandwidth, double R_s, double L) {
  return {omega_bandwidth * L, omega_bandwidth * R_s, omega_bandwidth};
}

// Speed loop of bandwidth f on inertia J through K_t. The integral is ten times slower than the
// loop, which keeps the overshoot after a fast ramp small.
//
//   K_p = 2 pi f J/K_t,  K_i = 0.1 2 pi f K_p,  k_awu = 2 pi f
inline PiGains speed_pi(double omega_bandwidth, double J, double K_t) {
  const double K_p = omega_bandwidth * J / K_t;
  return {K_p, 0.1 * omega_bandwidth * K_p, omega_bandwidth};
}

class Pi {
 public:
  Pi() = default;
  explicit Pi(const PiGains& gains) : gains_(gains) {}

  double output(double error) const { return gains_.K_p * error + integral_; }
  // After the limit: `u` of output(), `u_saturated` as it was passed on.
  void update(double error, double u, double u_saturated, double T_s) {
    integral_ += T_s * (gains_.K_i * error + gains_.k_awu * (u_saturated - u));
  }
  void preset(double integral) { integral_ = integral; }
  double integral() const { return integral_; }

 private:
  PiGains gains_;
  double integral_ = 0;
};

}  // namespace twinrate
