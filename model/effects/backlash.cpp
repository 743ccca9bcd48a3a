// Backlash: part of the inertia is behind a coupling or gear with free play.
//
//   (J - J_load) omega_m' = T_em - B omega_m - T_shaft
//   J_load omega_load'    = T_shaft - T_load
//   delta                 = theta_m - theta_load
//   T_shaft               = max(0, K (delta - gap/2) + D delta')    above the upper flank
//                         = 0                                       between the flanks
//                           mirrored below the lower flank
//
// A memory, so at() is zero: along() simulates the load in its gap behind the measured angle and
// gives T_load += T_shaft - T_load, J += -J_load.
#include "model/effects/memory.hpp"
#include "model/effects/registry.hpp"
#include "model/effects/shaft.hpp"

namespace twinrate {
namespace {

class Backlash final : public TraceableEffect, public EffectMemory {
 public:
  std::string_view kind() const override { return "backlash"; }
  std::string_view meaning() const override {
    return "part of the inertia behind a coupling or gear with free play";
  }
  int acts_on() const override { return kOnTorque; }
  std::vector<std::string> signals_needed() const override { return {"theta_m", "i_q"}; }
  void fields(FieldVisitor& f) override {
    f.number("J_load_kgm2", shaft_.J_load, 0, 1e4, "part of machine.J behind the gap",
             Presence::kRequired);
    f.number("gap_rad", shaft_.gap, 0, 1, "whole free play", Presence::kRequired);
    f.number("stiffness_Nm_rad", shaft_.stiffness, 1e-6, 1e9, "torque a radian beyond the gap",
             Presence::kRequired);
    f.number("damping_Nms_rad", shaft_.damping, 0, 1e6, "torque a rad/s of twisting in contact");
  }
  std::string prepare(const DriveFacts& facts) override {
    return shaft_.J_load < facts.machine.J ? "" : "J_load_kgm2 leaves the motor no inertia";
  }
  std::shared_ptr<Effect> clone() const override { return std::make_shared<Backlash>(*this); }
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
  // The shaft itself is searched round the torsion that comes nearest.
  std::vector<TracedKey> traced_keys() const override {
    return {{"gap_rad",
             {0.004, 0.0053, 0.0071, 0.0095, 0.0127, 0.017, 0.0226, 0.03, 0.05, 0.09, 0.16, 0.3}},
            {"J_load_kgm2"},
            {"stiffness_Nm_rad"},
            {"damping_Nms_rad"}};
  }
  double materiality(const DriveFacts&) const override { return shaft_.gap / 2.5e-3; }

  Traits traits() const override {
    static constexpr KeyPair kShaft[] = {{"J_load_kgm2", "J_load_kgm2"},
                                         {"stiffness_Nm_rad", "stiffness_Nm_rad"},
                                         {"damping_Nms_rad", "damping_Nms_rad"}};
    static constexpr Reading kReadings[] = {{Reading::kWithoutGap, "torsion", kShaft}};
    return {.equation = Equation::kMechanical,
            .family = {Family::kShaft, 1},
            .period = {.in = Period::kNothing},
            .repeats = {.how = Repeats::kOnce},
            .place = Place::kGap,
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
        .parameters =
            "J_load_kgm2 = 2.8e-3\ngap_rad = 0.02\nstiffness_Nm_rad = 300.0\n"
            "damping_Nms_rad = 0.1\n",
        .signal = Portrait::kTo,
        .over = Portrait::kOverTime,
        .equation =
            "T_shaft = K (delta -+ gap/2) + D delta' beyond the flanks, 0 between them; J_load "
            "omega_load' = T_shaft - T_load",
        .shows =
            "At a change of sign of the shaft torque the load crosses the gap. Until then the "
            "motor runs alone, with its own smaller inertia; an impact follows. Light loads "
            "bounce. Under a load that holds one flank only the stiffness is visible.",
        .taken_for =
            "`torsion`, which rings at one frequency at any amplitude; a coarse current ADC.",
        .from_s = 3.49,
        .to_s = 3.62,
        .drive = Portrait::kReversal};
    return kPortrait;
  }

 private:
  ShaftFacts shaft_{.stiffness = 1, .gap = 0.01};
};

}  // namespace

std::shared_ptr<Effect> make_backlash() {
  return std::make_shared<Backlash>();
}

}  // namespace twinrate
