// Flux of the magnets that differs from machine.psi_f: another magnet, a warm one, a partly
// demagnetised one.
//
//   psi_dq += [change, 0]
//
// In rotor axes it is a back-EMF of omega_e change along q and a torque of 3/2 n_p change i_q.
// Regressor: [1, 0]; coefficient change.
#include "model/effects/registry.hpp"
#include "model/effects/traced.hpp"

namespace twinrate {
namespace {

class FluxLinkage final : public TraceableEffect {
 public:
  std::string_view kind() const override { return "flux_linkage"; }
  std::string_view meaning() const override {
    return "difference of the magnet flux from machine.psi_f";
  }
  int acts_on() const override { return kOnFlux; }
  std::vector<std::string> signals_needed() const override {
    return {"i_d", "i_q", "u_d", "u_q", "theta_m"};
  }
  void fields(FieldVisitor& f) override {
    f.number("change_Wb", change_, -100, 100, "true flux less machine.psi_f", Presence::kRequired);
  }
  std::string prepare(const DriveFacts& facts) override {
    return facts.machine.psi_f + change_ > 0 ? "" : "change_Wb leaves no flux";
  }
  std::shared_ptr<Effect> clone() const override { return std::make_shared<FluxLinkage>(*this); }
  Contribution at(const OperatingPoint&) const override { return {.psi_dq = Vec2(change_, 0)}; }
  int regressor_count() const override { return 1; }
  void regressors(const OperatingPoint&, std::span<Contribution> columns) const override {
    columns[0] = {.psi_dq = Vec2(1, 0)};
  }
  void coefficients(std::span<double> values) const override { values[0] = change_; }
  void set_coefficients(std::span<const double> values) override { change_ = values[0]; }
  std::vector<TracedKey> traced_keys() const override { return {linear_key("change_Wb")}; }
  double materiality(const DriveFacts& facts) const override {
    return std::abs(change_) / (0.006 * facts.machine.psi_f);
  }

  Traits traits() const override {
    static constexpr Relative kRelatives[] = {{"current_gain", Run::kLoadStepsAndCurrents},
                                              {"encoder_offset", Run::kLoadStepsAndCurrents},
                                              {"voltage_gain", Run::kLoadStepsAndCurrents}};
    return {.equation = Equation::kElectrical,
            .family = {Family::kFlux, 0},
            .period = {.in = Period::kNothing},
            .repeats = {.how = Repeats::kOnce},
            .place = Place::kLinear,
            .noise = Noise::kSome,
            .on_command = Answer::kNo,
            .loss = Loss::kNo,
            .view = View::kVoltageOverSpeed,
            .told_by = Run::kVaried,
            .relatives = kRelatives,
            .readings = none,
            .bounds = none,
            .faults = none};
  }
  const Portrait& portrait() const override {
    static constexpr Portrait kPortrait{
        .parameters = "change_Wb = -0.02\n",
        .signal = Portrait::kUq,
        .over = Portrait::kOverSpeed,
        .equation = "psi_d += change",
        .shows =
            "Voltage along q proportional to the speed, and torque proportional to i_q: more "
            "current for the same load, and an error of the estimated load torque of the same "
            "ratio. No order.",
        .taken_for =
            "An error of the torque constant or of a current gain (torque alone), `voltage_gain` "
            "(voltage alone): the two equations together separate them."};
    return kPortrait;
  }

 private:
  double change_ = 0;
};

}  // namespace

std::shared_ptr<Effect> make_flux_linkage() {
  return std::make_shared<FluxLinkage>();
}

}  // namespace twinrate
