// Inertia that differs from machine.J: a coupling, another load.  (J + change) omega_m' = ..
//
// Regressor: 1 on the inertia (its torque is the change times the acceleration); coefficient
// change.
#include "model/effects/registry.hpp"

namespace twinrate {
namespace {

class Inertia final : public TraceableEffect {
 public:
  std::string_view kind() const override { return "inertia"; }
  std::string_view meaning() const override { return "difference of the inertia from machine.J"; }
  int acts_on() const override { return kOnTorque; }
  std::vector<std::string> signals_needed() const override { return {"omega_m", "i_q"}; }
  void fields(FieldVisitor& f) override {
    f.number("change_kgm2", change_, -1e4, 1e4, "true inertia less machine.J", Presence::kRequired);
  }
  std::string prepare(const DriveFacts& facts) override {
    return facts.machine.J + change_ > 0 ? "" : "change_kgm2 leaves no inertia";
  }
  std::shared_ptr<Effect> clone() const override { return std::make_shared<Inertia>(*this); }
  Contribution at(const OperatingPoint&) const override { return {.J = change_}; }
  int regressor_count() const override { return 1; }
  void regressors(const OperatingPoint&, std::span<Contribution> columns) const override {
    columns[0] = {.J = 1};
  }
  void coefficients(std::span<double> values) const override { values[0] = change_; }
  void set_coefficients(std::span<const double> values) override { change_ = values[0]; }
  std::vector<TracedKey> traced_keys() const override {
    return {{.key = "change_kgm2", .linear = true}};
  }
  double materiality(const DriveFacts& facts) const override {
    return std::abs(change_) / (0.02 * facts.machine.J);
  }

  Traits traits() const override {
    static constexpr Reading kReadings[] = {{Reading::kWithoutVoltage, "flux_linkage"},
                                            {Reading::kWithoutVoltage, "current_gain"}};
    return {.equation = Equation::kMechanical,
            .family = {Family::kInertia, 0},
            .period = {.in = Period::kNothing},
            .repeats = {.how = Repeats::kOnce},
            .place = Place::kLinear,
            .noise = Noise::kMimics,
            .on_command = Answer::kNo,
            .loss = Loss::kNo,
            .view = View::kShare,
            .told_by = Run::kReversals,
            .relatives = none,
            .readings = kReadings,
            .bounds = none,
            .faults = none};
  }
  const Portrait& portrait() const override {
    static constexpr Portrait kPortrait{
        .parameters = "change_kgm2 = 0.0088\n",
        .signal = Portrait::kTo,
        .over = Portrait::kOverSpeed,
        .equation = "(J + change) omega_m' = T_em - B omega_m - T_load",
        .shows =
            "An estimated load torque of change times acceleration: opposite signs at rising and "
            "falling speed, zero at constant speed. The response to a load step is slower.",
        .taken_for = "`constant_load` in a record that only accelerates; a wrong torque constant."};
    return kPortrait;
  }

 private:
  double change_ = 0;
};

}  // namespace

std::shared_ptr<Effect> make_inertia() {
  return std::make_shared<Inertia>();
}

}  // namespace twinrate
