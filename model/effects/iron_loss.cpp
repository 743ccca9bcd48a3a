// Iron loss, as a resistance R_c across the inner EMF, behind R_s.
//
//   i_fe = j omega_e psi/R_c = omega_e [-psi_q, psi_d]/R_c,   psi = [psi_f + L_d i_d, L_q i_q]
//   terminals carry i_dq + i_fe:  i_abc += inverse Park, Clarke of i_fe,  u_dq_drop = R_s i_fe
//
// The state i_dq is the current behind R_c, which makes the flux and the torque. Sensors, the
// inverter and effects that add to R_s (resistance, phase_asymmetry) are at the terminals.
// Hysteresis and eddy currents are combined; the EMF of a changing current is left out. The loss is
// 3/2 R_c |i_fe|^2 = 3/2 omega_e^2 |psi|^2/R_c. R_c = 0: no loss. Regressor: [R_s e, e] with e =
// R_c i_fe; coefficient 1/R_c.
#include "model/effects/registry.hpp"
#include "model/effects/traced.hpp"

namespace twinrate {
namespace {

class IronLoss final : public TraceableEffect {
 public:
  std::string_view kind() const override { return "iron_loss"; }
  std::string_view meaning() const override {
    return "current that feeds the iron losses, behind the terminals";
  }
  int acts_on() const override { return kOnVoltage | kOnCurrents; }
  bool drops_by_angle() const override { return true; }
  std::vector<std::string> signals_needed() const override {
    return {"i_d", "i_q", "u_d", "u_q", "theta_m", "omega_m"};
  }
  void fields(FieldVisitor& f) override {
    f.number("resistance_Ohm", R_c_, 0, 1e9, "across the inner EMF; 0: no loss",
             Presence::kRequired);
  }
  std::string prepare(const DriveFacts& facts) override {
    machine_ = facts.machine;
    return "";
  }
  std::shared_ptr<Effect> clone() const override { return std::make_shared<IronLoss>(*this); }
  Vec2 current_around(const OperatingPoint& point) const override {
    return conductance() * emf(point);
  }
  Contribution at(const OperatingPoint& point) const override {
    return of_current(point, conductance() * emf(point));
  }
  int regressor_count() const override { return 1; }
  void regressors(const OperatingPoint& point, std::span<Contribution> columns) const override {
    columns[0] = of_current(point, emf(point));
  }
  void coefficients(std::span<double> values) const override { values[0] = conductance(); }
  void set_coefficients(std::span<const double> values) override {
    R_c_ = values[0] == 0 ? 0 : 1 / values[0];
  }
  std::vector<TracedKey> traced_keys() const override { return {linear_key("resistance_Ohm")}; }
  double materiality(const DriveFacts& facts) const override {
    // 1/1500 S at the reference drive: 0.75 % of the rated current at rated speed.
    const MachineParameters& m = facts.machine;
    const double emf_rated = m.n_p * m.omega_m_rated * m.psi_f;
    return emf_rated > 0 && m.i_rated > 0
               ? std::abs(conductance()) * emf_rated / (0.0075 * m.i_rated)
               : std::abs(conductance()) * 1500;
  }

  Traits traits() const override {
    return {.equation = Equation::kElectrical,
            .family = {Family::kIron, 0},
            .period = {.in = Period::kNothing},
            .repeats = {.how = Repeats::kOnce},
            .place = Place::kLinear,
            .noise = Noise::kMimics,
            .on_command = Answer::kNo,
            .loss = Loss::kNo,
            .view = View::kShare,
            .told_by = Run::kConstantSpeeds,
            .relatives = none,
            .readings = none,
            .bounds = none,
            .faults = none};
  }
  const Portrait& portrait() const override {
    static constexpr Portrait kPortrait{
        .parameters = "resistance_Ohm = 100.0\n",
        .signal = Portrait::kIq,
        .over = Portrait::kOverSpeed,
        .equation =
            "i_fe = omega_e [-psi_q, psi_d]/R_c adds to the current at the terminals; u_dq_drop "
            "= R_s i_fe",
        .shows =
            "A measured q current proportional to the speed that makes no torque, so the estimated "
            "load torque rises like friction. The voltage hardly shows it. The currents of TRUTH "
            "are those behind R_c.",
        .taken_for =
            "`viscous_friction`: the same torque at every load; only the copper loss of i_fe and "
            "its d part, in proportion to load and speed, differ."};
    return kPortrait;
  }

 private:
  double conductance() const { return R_c_ == 0 ? 0 : 1 / R_c_; }
  Vec2 emf(const OperatingPoint& point) const {
    const double omega_e = machine_.n_p * point.omega_m;
    return omega_e *
           Vec2(-machine_.L_q * point.i_dq[1], machine_.psi_f + machine_.L_d * point.i_dq[0]);
  }
  Contribution of_current(const OperatingPoint& point, const Vec2& i_fe) const {
    return {.u_dq_drop = machine_.R_s * i_fe, .i_abc = inverse_clarke(point.stator_axes(i_fe))};
  }

  double R_c_ = 0;
  MachineParameters machine_;
};

}  // namespace

std::shared_ptr<Effect> make_iron_loss() {
  return std::make_shared<IronLoss>();
}

}  // namespace twinrate
