// Inductances that differ from those of the config.
//
//   psi_dq += [change_d i_d, change_q i_q]
//
// It appears as the voltage of a changing current, across the current at speed and, if the two
// differ, as reluctance torque. Regressors: [i_d, 0], [0, i_q]; coefficients change_d, change_q.
#include <algorithm>

#include "model/effects/registry.hpp"
#include "model/effects/traced.hpp"

namespace twinrate {
namespace {

class Inductance final : public TraceableEffect {
 public:
  std::string_view kind() const override { return "inductance"; }
  std::string_view meaning() const override {
    return "difference of the inductances from machine.L_d and machine.L_q";
  }
  int acts_on() const override { return kOnFlux; }
  std::vector<std::string> signals_needed() const override {
    return {"i_d", "i_q", "u_d", "u_q", "theta_m"};
  }
  void fields(FieldVisitor& f) override {
    f.number("change_d_H", change_[0], -10, 10, "true L_d less machine.L_d", Presence::kRequired);
    f.number("change_q_H", change_[1], -10, 10, "true L_q less machine.L_q", Presence::kRequired);
  }
  std::string prepare(const DriveFacts& facts) override {
    if (facts.machine.L_d + change_[0] <= 0) return "change_d_H leaves no inductance";
    return facts.machine.L_q + change_[1] > 0 ? "" : "change_q_H leaves no inductance";
  }
  std::shared_ptr<Effect> clone() const override { return std::make_shared<Inductance>(*this); }
  Contribution at(const OperatingPoint& point) const override {
    return {.psi_dq = change_.cwiseProduct(point.i_dq)};
  }
  int regressor_count() const override { return 2; }
  void regressors(const OperatingPoint& point, std::span<Contribution> columns) const override {
    columns[0] = {.psi_dq = Vec2(point.i_dq[0], 0)};
    columns[1] = {.psi_dq = Vec2(0, point.i_dq[1])};
  }
  void coefficients(std::span<double> values) const override {
    values[0] = change_[0];
    values[1] = change_[1];
  }
  void set_coefficients(std::span<const double> values) override {
    change_ = {values[0], values[1]};
  }
  std::vector<TracedKey> traced_keys() const override {
    return {linear_key("change_d_H"), linear_key("change_q_H")};
  }
  double materiality(const DriveFacts& facts) const override {
    const MachineParameters& m = facts.machine;
    return std::max(std::abs(change_[0]) / m.L_d, std::abs(change_[1]) / m.L_q) / 0.015;
  }

  Traits traits() const override {
    return {.equation = Equation::kElectrical,
            .family = {Family::kFlux, 1},
            .period = {.in = Period::kNothing},
            .repeats = {.how = Repeats::kOnce},
            .place = Place::kLinear,
            .noise = Noise::kMimics,
            .on_command = Answer::kNo,
            .loss = Loss::kNo,
            .view = View::kFluxOverItsCurrent,
            .told_by = Run::kVaried,
            .relatives = none,
            .readings = none,
            .bounds = none,
            .faults = none};
  }
  const Portrait& portrait() const override {
    static constexpr Portrait kPortrait{
        .parameters = "change_d_H = 4e-3\nchange_q_H = 4e-3\n",
        .signal = Portrait::kUd,
        .over = Portrait::kOverTime,
        .equation = "psi_d += change_d i_d, psi_q += change_q i_q",
        .shows =
            "Voltage across the current at speed, here along d, omega_e change_q i_q, and the "
            "response of the currents to a voltage step. If the changes differ, a small reluctance "
            "torque.",
        .taken_for = "`encoder_offset` (u_d at one load and speed); `saturation` at one load."};
    return kPortrait;
  }

 private:
  Vec2 change_ = Vec2::Zero();
};

}  // namespace

std::shared_ptr<Effect> make_inductance() {
  return std::make_shared<Inductance>();
}

}  // namespace twinrate
