// Load step: a torque from one moment on, acting where T_load acts. T_load += T for t >= t_step
//
// The integrator does not stop at t_step: put it on a tick if that matters. Regressor: 1 from
// t_step on; coefficient T.
#include "model/effects/materiality.hpp"
#include "model/effects/registry.hpp"

namespace twinrate {
namespace {

class LoadStep final : public TraceableEffect {
 public:
  std::string_view kind() const override { return "load_step"; }
  std::string_view meaning() const override { return "torque that begins at one time"; }
  int acts_on() const override { return kOnTorque; }
  bool behind_shaft() const override { return true; }
  std::vector<std::string> signals_needed() const override { return {"t", "i_q"}; }
  void fields(FieldVisitor& f) override {
    f.number("torque_Nm", T_, -1e4, 1e4, "opposes positive speed", Presence::kRequired);
    f.number("time_s", t_step_, 0, 1e5, "drive time from which it acts", Presence::kRequired);
  }
  std::shared_ptr<Effect> clone() const override { return std::make_shared<LoadStep>(*this); }
  Contribution at(const OperatingPoint& point) const override {
    return {.T_load = point.t >= t_step_ ? T_ : 0};
  }
  int regressor_count() const override { return 1; }
  void regressors(const OperatingPoint& point, std::span<Contribution> columns) const override {
    columns[0] = {.T_load = point.t >= t_step_ ? 1.0 : 0.0};
  }
  void coefficients(std::span<double> values) const override { values[0] = T_; }
  void set_coefficients(std::span<const double> values) override { T_ = values[0]; }
  std::vector<TracedKey> traced_keys() const override {
    return {{"time_s"}, {.key = "torque_Nm", .linear = true}};
  }
  double materiality(const DriveFacts& facts) const override {
    return std::abs(T_) / smallest_torque(facts, 20e-3);
  }

  Traits traits() const override {
    static constexpr KeyPair kTorque[] = {{"torque_Nm", "torque_Nm"}};
    static constexpr Reading kReadings[] = {{Reading::kFromTheBeginning, "constant_load", kTorque}};
    return {.equation = Equation::kMechanical,
            .family = {Family::kLoad, 1},
            .period = {.in = Period::kNothing},
            .repeats = {.how = Repeats::kByKey, .key = "time_s", .distance = 0.25},
            .place = Place::kMoment,
            .noise = Noise::kNone,
            .on_command = Answer::kNo,
            .loss = Loss::kNo,
            .view = View::kTorqueOverTime,
            .told_by = Run::kVaried,
            .relatives = none,
            .readings = kReadings,
            .bounds = none,
            .faults = none};
  }
  const Portrait& portrait() const override {
    static constexpr Portrait kPortrait{
        .parameters = "torque_Nm = 1.0\ntime_s = 3.5\n",
        .signal = Portrait::kTo,
        .over = Portrait::kOverTime,
        .equation = "T_load += T for t >= t_step, behind a shaft where there is one",
        .shows =
            "One dip of the speed, and a step of the estimated load torque with the rise time of "
            "the observer.",
        .taken_for = "`constant_load`, if the step is not in the record.",
        .from_s = 3.45,
        .to_s = 3.7};
    return kPortrait;
  }

 private:
  double T_ = 0;
  double t_step_ = 0;
};

}  // namespace

std::shared_ptr<Effect> make_load_step() {
  return std::make_shared<LoadStep>();
}

}  // namespace twinrate
