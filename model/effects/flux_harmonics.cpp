// Flux harmonics: the flux of the magnets along d varies with the angle.       (Niewiara (8))
//
//   delta_psi_d = A cos(N theta_m + phase)
//   u_dq_drop = [d delta_psi/dt, omega_e delta_psi]
//   T_load -= 3/2 n_p (delta_psi i_q + (d delta_psi/d theta_e) i_d)
//
// Voltage and torque belong together: the power 3/2 i_dq u_dq_drop taken from the terminals is the
// mechanical power -T_load omega_m, at every operating point. N counts a mechanical turn, 6 n_p and
// its multiples in a symmetric machine. Regressors at given N: the same with cos(N theta_m) and
// with -sin(N theta_m) for delta_psi/A; coefficients A cos(phase), A sin(phase).
#include <algorithm>

#include "model/effects/registry.hpp"
#include "model/effects/shapes.hpp"
#include "model/effects/traced.hpp"
#include "model/math.hpp"

namespace twinrate {
namespace {

class FluxHarmonics final : public TraceableEffect {
 public:
  std::string_view kind() const override { return "flux_harmonics"; }
  std::string_view meaning() const override {
    return "flux of the magnets that varies with the angle";
  }
  int acts_on() const override { return kOnVoltage | kOnTorque; }
  bool drops_by_angle() const override { return true; }
  std::vector<std::string> signals_needed() const override {
    return {"i_d", "i_q", "u_d", "u_q", "theta_m", "omega_m"};
  }
  void fields(FieldVisitor& f) override {
    f.integer("order", order_, 1, 2000, "periods a mechanical turn", Presence::kRequired);
    f.number("amplitude_Wb", amplitude_, 0, 100, "peak deviation of the flux along d",
             Presence::kRequired);
    f.number("phase_rad", phase_, -2 * kTwoPi, 2 * kTwoPi, "phase of the cosine at theta_m = 0");
  }
  std::string prepare(const DriveFacts& facts) override {
    n_p_ = facts.machine.n_p;
    return "";
  }
  std::shared_ptr<Effect> clone() const override { return std::make_shared<FluxHarmonics>(*this); }
  Contribution at(const OperatingPoint& point) const override {
    const auto [s, c] = math::sincos(order_ * point.theta_m + phase_);
    return of_flux(point, amplitude_ * c, -amplitude_ * order_ * s);
  }
  int regressor_count() const override { return 2; }
  void regressors(const OperatingPoint& point, std::span<Contribution> columns) const override {
    const auto [s, c] = math::sincos(order_ * point.theta_m);
    columns[0] = of_flux(point, c, -order_ * s);
    columns[1] = of_flux(point, -s, -order_ * c);
  }
  void coefficients(std::span<double> values) const override {
    sine_coefficients(amplitude_, phase_, values);
  }
  void set_coefficients(std::span<const double> values) override {
    set_sine(values, amplitude_, phase_);
  }
  std::vector<TracedKey> traced_keys() const override {
    // Of the electrical turn, and the slow ones of a magnet unlike the others.
    std::vector<double> orders{1, 2};
    for (int order = n_p_; order <= std::max(60, 12 * n_p_); order += n_p_)
      if (order > 2) orders.push_back(order);
    return {linear_key("amplitude_Wb"), linear_key("phase_rad"), {"order", orders, false}};
  }
  double materiality(const DriveFacts& facts) const override {
    return amplitude_ / (1e-3 * facts.machine.psi_f);
  }

  Traits traits() const override {
    return {.equation = Equation::kElectrical,
            .family = {Family::kFlux, 4},
            .period = {.in = Period::kAngle, .order_key = "order"},
            .repeats = {.how = Repeats::kByKey, .key = "order"},
            .place = Place::kGrid,
            .noise = Noise::kNone,
            .on_command = Answer::kNo,
            .loss = Loss::kNo,
            .view = View::kShare,
            .told_by = Run::kSlowBothWays,
            .relatives = none,
            .readings = none,
            .bounds = none,
            .faults = none};
  }
  const Portrait& portrait() const override {
    static constexpr Portrait kPortrait{
        .parameters = "order = 18\namplitude_Wb = 2.5e-3\n",
        .signal = Portrait::kTo,
        .over = Portrait::kOverTurns,
        .equation =
            "delta_psi_d = A cos(N theta_m + phase); u_dq_drop = [d delta_psi/dt, omega_e "
            "delta_psi]; T_load -= 3/2 n_p (delta_psi i_q + d delta_psi/d theta_e i_d)",
        .shows =
            "Order N in the torque, proportional to i_q, and in u_d, u_q, proportional to the "
            "speed.",
        .taken_for =
            "`cogging` of the same order at one load; `dead_time`, which also has 6 n_p, but in "
            "the voltage at any speed."};
    return kPortrait;
  }

 private:
  // slope: d delta_psi/d theta_m
  Contribution of_flux(const OperatingPoint& point, double delta_psi, double slope) const {
    return {.T_load = -1.5 * (n_p_ * delta_psi * point.i_dq[1] + slope * point.i_dq[0]),
            .u_dq_drop = point.omega_m * Vec2(slope, n_p_ * delta_psi)};
  }

  int order_ = 1;
  double amplitude_ = 0;
  double phase_ = 0;
  int n_p_ = 1;
};

}  // namespace

std::shared_ptr<Effect> make_flux_harmonics() {
  return std::make_shared<FluxHarmonics>();
}

}  // namespace twinrate
