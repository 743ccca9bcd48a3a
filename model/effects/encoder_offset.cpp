// Encoder zero that is not the d axis.  theta_meas = theta_m + offset
//
// Regressor: 1; coefficient offset.
#include "model/effects/registry.hpp"
#include "model/effects/traced.hpp"

namespace twinrate {
namespace {

class EncoderOffset final : public TraceableEffect {
 public:
  std::string_view kind() const override { return "encoder_offset"; }
  std::string_view meaning() const override { return "error of the zero of the angle reading"; }
  int acts_on() const override { return kOnAngle; }
  std::vector<std::string> signals_needed() const override { return {"theta_m", "u_d", "u_q"}; }
  void fields(FieldVisitor& f) override {
    f.number("offset_rad", offset_, -kTwoPi, kTwoPi, "measured less true angle, mechanical",
             Presence::kRequired);
  }
  std::shared_ptr<Effect> clone() const override { return std::make_shared<EncoderOffset>(*this); }
  Contribution at(const OperatingPoint&) const override { return {.theta_m = offset_}; }
  int regressor_count() const override { return 1; }
  void regressors(const OperatingPoint&, std::span<Contribution> columns) const override {
    columns[0] = {.theta_m = 1};
  }
  void coefficients(std::span<double> values) const override { values[0] = offset_; }
  void set_coefficients(std::span<const double> values) override { offset_ = values[0]; }
  std::vector<TracedKey> traced_keys() const override { return {linear_key("offset_rad")}; }
  double materiality(const DriveFacts&) const override { return std::abs(offset_) / 2e-3; }

  Traits traits() const override {
    static constexpr Relative kRelatives[] = {{"flux_linkage", Run::kLoadStepsAndCurrents}};
    return {.equation = Equation::kSensing,
            .family = {Family::kAngleSensor, 0},
            .period = {.in = Period::kNothing},
            .repeats = {.how = Repeats::kOnce},
            .place = Place::kLinear,
            .noise = Noise::kSome,
            .on_command = Answer::kNo,
            .loss = Loss::kNo,
            .view = View::kShare,
            .told_by = Run::kVaried,
            .relatives = kRelatives,
            .readings = none,
            .bounds = none,
            .faults = none};
  }
  const Portrait& portrait() const override {
    static constexpr Portrait kPortrait{
        .parameters = "offset_rad = 0.05\n",
        .signal = Portrait::kUd,
        .over = Portrait::kOverTurns,
        .equation = "theta_meas = theta_m + offset",
        .shows =
            "No order: the current vector is rotated, a true i_d appears, the torque per ampere "
            "falls by cos(n_p offset), u_d shifts.",
        .taken_for = "`flux_linkage` (less torque); an inductance error (u_d)."};
    return kPortrait;
  }

 private:
  double offset_ = 0;
};

}  // namespace

std::shared_ptr<Effect> make_encoder_offset() {
  return std::make_shared<EncoderOffset>();
}

}  // namespace twinrate
