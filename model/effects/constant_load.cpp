// Constant load: a torque independent of the direction, like that of a hanging weight, which acts
// where T_load acts. T_load += T
//
// Regressor: 1; coefficient T.
#include "model/effects/materiality.hpp"
#include "model/effects/registry.hpp"

namespace twinrate {
namespace {

class ConstantLoad final : public TraceableEffect {
 public:
  std::string_view kind() const override { return "constant_load"; }
  std::string_view meaning() const override {
    return "constant torque, such as that of a hanging weight";
  }
  int acts_on() const override { return kOnTorque; }
  bool behind_shaft() const override { return true; }
  std::vector<std::string> signals_needed() const override { return {"i_q"}; }
  void fields(FieldVisitor& f) override {
    f.number("torque_Nm", T_, -1e4, 1e4, "opposes positive speed", Presence::kRequired);
  }
  std::shared_ptr<Effect> clone() const override { return std::make_shared<ConstantLoad>(*this); }
  Contribution at(const OperatingPoint&) const override { return {.T_load = T_}; }
  int regressor_count() const override { return 1; }
  void regressors(const OperatingPoint&, std::span<Contribution> columns) const override {
    columns[0] = {.T_load = 1};
  }
  void coefficients(std::span<double> values) const override { values[0] = T_; }
  void set_coefficients(std::span<const double> values) override { T_ = values[0]; }
  std::vector<TracedKey> traced_keys() const override {
    return {{.key = "torque_Nm", .linear = true}};
  }
  double materiality(const DriveFacts& facts) const override {
    return std::abs(T_) / smallest_torque(facts, 10e-3);
  }

  Traits traits() const override {
    return {.equation = Equation::kMechanical,
            .family = {Family::kLoad, 0},
            .period = {.in = Period::kNothing},
            .repeats = {.how = Repeats::kOnce},
            .place = Place::kLinear,
            .noise = Noise::kNone,
            .on_command = Answer::kNo,
            .loss = Loss::kNo,
            .view = View::kTorqueOverSpeed,
            .told_by = Run::kConstantSpeeds,
            .relatives = none,
            .readings = none,
            .bounds = none,
            .faults = none};
  }
  const Portrait& portrait() const override {
    static constexpr Portrait kPortrait{
        .parameters = "torque_Nm = 0.5\n",
        .signal = Portrait::kTo,
        .over = Portrait::kOverSpeed,
        .equation = "T_load += T, behind a shaft where there is one",
        .shows = "A shift of the estimated load torque and of i_q, the same in both directions.",
        .taken_for =
            "`coulomb_friction` in one direction; the offset of a torque or q-current sensor."};
    return kPortrait;
  }

 private:
  double T_ = 0;
};

}  // namespace

std::shared_ptr<Effect> make_constant_load() {
  return std::make_shared<ConstantLoad>();
}

}  // namespace twinrate
