// Cogging: the magnets pull on the slots.       (Niewiara (9), one term)
//
//   T_load += A sin(N theta_m + phase)
//
// N comes from `order` and `origin`:
//   order   N = order
//   native  N = order lcm(n_slots, 2 n_p)   the perfect machine has only these
//   slots   N = order n_slots               imperfect rotor: a magnet unlike the others
//   poles   N = order 2 n_p                 imperfect stator: a tooth unlike the others
//
// Regressors at a given N: sin(N theta_m), cos(N theta_m); coefficients A cos(phase), A sin(phase).
#include <numeric>

#include "model/effects/materiality.hpp"
#include "model/effects/registry.hpp"
#include "model/effects/shapes.hpp"
#include "model/math.hpp"

namespace twinrate {
namespace {

class Cogging final : public TraceableEffect {
 public:
  std::string_view kind() const override { return "cogging"; }
  std::string_view meaning() const override { return "torque periodic in the mechanical angle"; }
  int acts_on() const override { return kOnTorque; }
  std::vector<std::string> signals_needed() const override { return {"theta_m", "i_q"}; }
  void fields(FieldVisitor& f) override {
    f.integer("order", order_, 1, 2000, "periods a mechanical turn, or a multiple of the origin's",
              Presence::kRequired);
    f.choice("origin", origin_, kOriginNames,
             "unit of order: turns, lcm(slots, poles), slots or poles");
    f.number("amplitude_Nm", amplitude_, 0, 1e4, "peak torque", Presence::kRequired);
    f.number("phase_rad", phase_, -2 * kTwoPi, 2 * kTwoPi, "phase of the sine at theta_m = 0");
  }
  std::string prepare(const DriveFacts& facts) override {
    const int n_slots = facts.machine.n_slots, n_poles = 2 * facts.machine.n_p;
    if ((origin_ == kNative || origin_ == kSlots) && n_slots == 0)
      return std::string("origin = \"") + kOriginNames[origin_] + "\" needs machine.n_slots";
    const int unit[] = {1, std::lcm(n_slots, n_poles), n_slots, n_poles};
    unit_ = unit[origin_];
    return "";
  }
  std::shared_ptr<Effect> clone() const override { return std::make_shared<Cogging>(*this); }
  Contribution at(const OperatingPoint& point) const override {
    return {.T_load = amplitude_ * math::sin(N() * point.theta_m + phase_)};
  }
  int regressor_count() const override { return 2; }
  void regressors(const OperatingPoint& point, std::span<Contribution> columns) const override {
    const auto [s, c] = math::sincos(N() * point.theta_m);
    columns[0] = {.T_load = s};
    columns[1] = {.T_load = c};
  }
  void coefficients(std::span<double> values) const override {
    sine_coefficients(amplitude_, phase_, values);
  }
  void set_coefficients(std::span<const double> values) override {
    set_sine(values, amplitude_, phase_);
  }
  std::vector<TracedKey> traced_keys() const override {
    // Once a turn is an eccentric load.
    return {{"order", whole_orders(2, 60), false},
            {.key = "amplitude_Nm", .linear = true},
            {.key = "phase_rad", .linear = true}};
  }
  double materiality(const DriveFacts& facts) const override {
    return std::abs(amplitude_) / smallest_torque(facts, 4e-3);
  }

  Traits traits() const override {
    static constexpr Relative kRelatives[] = {{"eccentric_load", Run::kUncoupled}};
    static constexpr Reading kReadings[] = {{Reading::kAtOrderOfPolePairs, "current_offset"},
                                            {Reading::kAtTwiceThatOrder, "current_gain"}};
    return {.equation = Equation::kMechanical,
            .family = {Family::kTorqueRipple, 0},
            .period = {.in = Period::kAngle, .order_key = "order"},
            .repeats = {.how = Repeats::kByKey, .key = "order"},
            .place = Place::kGrid,
            .noise = Noise::kNone,
            .on_command = Answer::kNo,
            .loss = Loss::kNo,
            .view = View::kTorqueOverPeriod,
            .told_by = Run::kSlowBothWays,
            .relatives = kRelatives,
            .readings = kReadings,
            .bounds = none,
            .faults = none};
  }
  const Portrait& portrait() const override {
    static constexpr Portrait kPortrait{
        .parameters =
            "origin = \"poles\"\norder = 1\namplitude_Nm = 0.03\nphase_rad = 0.4\n[[effect]]\n"
            "kind = \"cogging\"\norigin = \"slots\"\norder = 1\namplitude_Nm = 0.04\n[[effect]]\n"
            "kind = \"cogging\"\norigin = \"native\"\norder = 1\namplitude_Nm = 0.06\n",
        .signal = Portrait::kTo,
        .over = Portrait::kOverTurns,
        .equation =
            "T_load += A sin(N theta_m + phase), with N = order x {1, lcm(n_slots, 2 n_p), "
            "n_slots, 2 n_p} for origin = order, native, slots, poles",
        .shows =
            "Speed, i_q and the estimated load torque at order N, at every load and in either "
            "direction with the same angle. The example has one term of each origin: 6 poles, 27 "
            "slots, 54 native; the observer, too slow for them at one turn per second, shows 23 of "
            "40 and 19 of 60 mNm.",
        .taken_for =
            "`flux_harmonics` at constant current (it grows with i_q, cogging does not); "
            "`friction_ripple` in one direction."};
    return kPortrait;
  }

 private:
  double N() const { return order_ * unit_; }

  static constexpr const char* kOriginNames[] = {"order", "native", "slots", "poles"};
  enum Origin : int { kOrder = 0, kNative = 1, kSlots = 2, kPoles = 3 };

  int order_ = 1;
  Origin origin_ = kOrder;
  double amplitude_ = 0;
  double phase_ = 0;
  int unit_ = 1;
};

}  // namespace

std::shared_ptr<Effect> make_cogging() {
  return std::make_shared<Cogging>();
}

}  // namespace twinrate
