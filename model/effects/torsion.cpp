// Torsion: part of the inertia is behind a shaft that twists (two masses).
//
//   (J - J_load) omega_m' = T_em - B omega_m - T_shaft
//   J_load omega_load'    = T_shaft - T_load
//   T_shaft               = K delta + D delta',  delta = theta_m - theta_load
//
//   antiresonance         sqrt(K/J_load)                            rad/s, seen from the motor
//   resonance             sqrt(K (1/J_load + 1/(J - J_load)))       rad/s, seen from the motor
//
// The effect has a memory, so at() is zero. along() simulates the load behind the measured angle
// and gives T_load += T_shaft - T_load, J += -J_load. At a given antiresonance and damping ratio
// that is linear in J_load.

#include "model/effects/memory.hpp"
#include "model/effects/registry.hpp"
#include "model/effects/shaft.hpp"

namespace twinrate {
namespace {

class Torsion final : public TraceableEffect, public EffectMemory {
 public:
  std::string_view kind() const override { return "torsion"; }
  std::string_view meaning() const override {
    return "part of the inertia behind a shaft that twists: two masses";
  }
  int acts_on() const override { return kOnTorque; }
  std::vector<std::string> signals_needed() const override { return {"theta_m", "i_q"}; }
  void fields(FieldVisitor& f) override {
    f.number("J_load_kgm2", shaft_.J_load, 0, 1e4, "part of machine.J behind the shaft",
             Presence::kRequired);
    f.number("stiffness_Nm_rad", shaft_.stiffness, 1e-6, 1e9, "torque a radian of twist",
             Presence::kRequired);
    f.number("damping_Nms_rad", shaft_.damping, 0, 1e6, "torque a rad/s of twisting");
  }
  std::string prepare(const DriveFacts& facts) override {
    J_ = facts.machine.J;
    return shaft_.J_load < J_ ? "" : "J_load_kgm2 leaves the motor no inertia";
  }
  std::shared_ptr<Effect> clone() const override { return std::make_shared<Torsion>(*this); }
  bool describe_shaft(ShaftFacts& facts) const override {
    if (shaft_.J_load > 0) facts = shaft_;
    return true;
  }
  Contribution at(const OperatingPoint&) const override { return {}; }
  const EffectMemory* memory() const override { return this; }
  void along(std::span<const OperatingPoint> record, double T_s,
             std::span<Contribution> sums) const override {
    along_shaft(shaft_, record, T_s, sums);
  }
  int regressor_count() const override { return 0; }
  void regressors(const OperatingPoint&, std::span<Contribution>) const override {}
  void coefficients(std::span<double>) const override {}
  // The stiffness: antiresonances from 2.5 to 75 Hz, one of them at 12 Hz. The damping: ratios of
  // some per cent in the middle of that.
  std::vector<TracedKey> traced_keys() const override {
    constexpr double kMiddle = 0.28;  // J_load over J, of the grid
    std::vector<double> stiffness;
    for (double f = 2.4861; f < 80; f *= 1.3)
      stiffness.push_back(kMiddle * J_ * ((kTwoPi * f) * (kTwoPi * f)));
    return {{"J_load_kgm2", {0.15 * J_, 0.4 * J_}},
            {"stiffness_Nm_rad", stiffness},
            {"damping_Nms_rad", {3 * J_}}};
  }
  double materiality(const DriveFacts& facts) const override {
    return shaft_.J_load / (0.05 * facts.machine.J);
  }

  Traits traits() const override {
    static constexpr KeyPair kShaft[] = {{"J_load_kgm2", "J_load_kgm2"},
                                         {"stiffness_Nm_rad", "stiffness_Nm_rad"},
                                         {"damping_Nms_rad", "damping_Nms_rad"}};
    static constexpr Reading kReadings[] = {{Reading::kWhereBurstsRemain, "backlash", kShaft}};
    return {.equation = Equation::kMechanical,
            .family = {Family::kShaft, 0},
            .period = {.in = Period::kNothing},
            .repeats = {.how = Repeats::kOnce},
            .place = Place::kShaft,
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
        .parameters = "J_load_kgm2 = 2.8e-3\nstiffness_Nm_rad = 61.8\ndamping_Nms_rad = 0.0317\n",
        .signal = Portrait::kTo,
        .over = Portrait::kOverTime,
        .equation =
            "T_shaft = K delta + D delta', delta = theta_m - theta_load; J_load omega_load' = "
            "T_shaft - T_load",
        .shows =
            "Ringing after every step of torque, at sqrt(K (1/J_load + 1/(J - J_load)))/2 pi (29 "
            "Hz here) at constant current, and lower under a speed controller, which holds the "
            "motor while the load oscillates at sqrt(K/J_load)/2 pi (24 Hz). No effect at constant "
            "speed.",
        .taken_for = "`inertia` in slow manoeuvres; a speed controller with too high a gain.",
        .from_s = 3.49,
        .to_s = 3.75,
        .drive = Portrait::kReversal};
    return kPortrait;
  }

 private:
  ShaftFacts shaft_{.stiffness = 1};
  double J_ = 0;
};

}  // namespace

std::shared_ptr<Effect> make_torsion() {
  return std::make_shared<Torsion>();
}

}  // namespace twinrate
