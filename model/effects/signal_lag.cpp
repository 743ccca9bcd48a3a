// A signal with a lag: a delay, or a first-order filter.
//
//   delay          reading(t) = true(t - lag)
//   first_order    lag reading' = true - reading; a delay_share of the lag may be a pure delay in
//                  front of the filter
//
// signal current, angle, speed: a lag of the reading. signal voltage: the request acts lag later,
// so it is early by lag in a log; over a sample the acting mean is (1 - f) u_{k-n} + f u_{k-n-1} in
// stator axes, n + f = lag/T_s (first_order: the mean after the filter, model/effects/lag.hpp).
//
// A memory, so at() is zero: along() gives u_dq_drop (requested less acting) or reading less truth,
// linear between samples.
#include "model/effects/lag.hpp"
#include "model/effects/memory.hpp"
#include "model/effects/registry.hpp"

namespace twinrate {
namespace {

using Record = std::span<const OperatingPoint>;
using Sums = std::span<Contribution>;

// A sequence after a delay and a filter, either of which may be absent.
template <class Value, class Filter>
class Late {
 public:
  Late(double delay, double tau, double T_s) : delay_(delay, T_s), filter_(tau, T_s) {}
  Value pass(const Value& x) { return filter_.pass(delay_.pass(x)); }

 private:
  DelayLine<Value> delay_;
  Filter filter_;
};

class SignalLag final : public TraceableEffect, public EffectMemory {
 public:
  std::string_view kind() const override { return "signal_lag"; }
  std::string_view meaning() const override {
    return "delay of a signal, or a first-order filter in it";
  }
  int acts_on() const override {
    constexpr int kActs[] = {kOnVoltage, kOnCurrents, kOnAngle, kOnSpeed};
    return kActs[signal_];
  }
  std::vector<std::string> signals_needed() const override {
    switch (signal_) {
      case SamplingFacts::kCurrent:
        return {"i_a", "i_b", "theta_m", "u_d", "u_q"};
      case SamplingFacts::kSpeed:
        return {"omega_m", "theta_m"};
      default:
        return {"u_d", "u_q", "theta_m", "i_d", "i_q"};
    }
  }
  void fields(FieldVisitor& f) override {
    f.choice("signal", signal_, kSignalNames, "signal that is late");
    f.choice("form", form_, kFormNames, "a pure delay, or a first-order filter");
    f.number("lag_s", lag_, 0, 0.5, "the delay, or the filter's time constant",
             Presence::kRequired);
    f.number("delay_share", delay_share_, 0, 1,
             "share of the lag that is a pure delay; the rest is a first-order time constant");
  }
  std::shared_ptr<Effect> clone() const override { return std::make_shared<SignalLag>(*this); }
  bool describe_sampling(SamplingFacts& facts) const override {
    facts.delay[signal_] += delay();
    facts.lowpass[signal_] += tau();
    return true;
  }
  Contribution at(const OperatingPoint&) const override { return {}; }
  const EffectMemory* memory() const override { return this; }
  void along(Record record, double T_s, Sums sums) const override {
    switch (signal_) {
      case SamplingFacts::kVoltage:
        return voltage(record, T_s, sums);
      case SamplingFacts::kCurrent:
        return current(record, T_s, sums);
      case SamplingFacts::kAngle:
        return angle(record, T_s, sums);
      default:
        return rotor_speed(record, T_s, sums);
    }
  }
  int regressor_count() const override { return 0; }
  void regressors(const OperatingPoint&, std::span<Contribution>) const override {}
  void coefficients(std::span<double>) const override {}
  std::vector<TracedKey> traced_keys() const override {
    return {{"signal", {0, 1, 2, 3}, false},
            {"form", {0, 1}, false},
            {.key = "lag_s", .grid = {50e-6}, .linear = true}};
  }
  double materiality(const DriveFacts&) const override {
    return lag_ / (signal_ == SamplingFacts::kSpeed ? 50e-6 : 12e-6);
  }

  Traits traits() const override {
    const bool late_voltage = signal_ == SamplingFacts::kVoltage;
    // A late angle turns the voltage by far more than noise does. Only noise distinguishes it from
    // a late voltage, and a filter from a delay.
    const bool late_angle = signal_ == SamplingFacts::kAngle && delay() > 0;
    return {.equation = late_voltage ? Equation::kElectrical : Equation::kSensing,
            .family = {Family::kLag, 0},
            .period = {.in = Period::kNothing},
            .repeats = {.how = Repeats::kByKey, .key = "signal"},
            .place = Place::kGrid,
            .noise = late_angle ? Noise::kSome : Noise::kMimics,
            .on_command = late_voltage ? Answer::kYes : Answer::kNo,
            .loss = Loss::kNo,
            .view = View::kShare,
            .told_by = Run::kVaried,
            .relatives = none,
            .readings = none,
            .bounds = none,
            .faults = none};
  }
  const Portrait& portrait() const override {
    static constexpr Portrait kPortrait{
        .parameters = "signal = \"angle\"\nform = \"delay\"\nlag_s = 3e-4\n",
        .signal = Portrait::kAngle,
        .over = Portrait::kOverSpeed,
        .equation =
            "reading(t) = true(t - lag), or lag reading' = true - reading; a late voltage acts "
            "later than the log has it",
        .shows =
            "No order. Late angle: an error of speed times lag. Late current: a vector turned back "
            "by omega_e lag. Late voltage: the difference of two samples, visible when the voltage "
            "changes. Late speed: its slope times lag.",
        .taken_for =
            "`encoder_offset` at one speed (angle); `resistance` and `inductance` (a filter in "
            "the current path)."};
    return kPortrait;
  }

 private:
  static constexpr const char* kSignalNames[] = {"voltage", "current", "angle", "speed"};
  enum Form : int { kDelay, kFirstOrder };
  static constexpr const char* kFormNames[] = {"delay", "first_order"};

  double delay() const { return form_ == kDelay ? lag_ : delay_share_ * lag_; }
  double tau() const { return lag_ - delay(); }

  void voltage(Record record, double T_s, Sums sums) const {
    Late<Vec2, HeldLowPass<Vec2>> late(delay(), tau(), T_s);
    for (std::size_t k = 0; k < record.size(); ++k) {
      const Vec2 u_alphabeta = record[k].stator_axes(record[k].u_dq);
      sums[k] = {.u_dq_drop = record[k].rotor_axes(u_alphabeta - late.pass(u_alphabeta))};
    }
  }
  void current(Record record, double T_s, Sums sums) const {
    Late<Vec2, LowPass<Vec2>> late(delay(), tau(), T_s);
    for (std::size_t k = 0; k < record.size(); ++k) {
      const Vec2 i_alphabeta = record[k].stator_axes(record[k].i_dq);
      sums[k] = {.i_abc = inverse_clarke(late.pass(i_alphabeta) - i_alphabeta)};
    }
  }
  // theta_m may be wrapped into a turn.
  void angle(Record record, double T_s, Sums sums) const {
    Late<double, LowPass<double>> late(delay(), tau(), T_s);
    double turned = 0;
    for (std::size_t k = 0; k < record.size(); ++k) {
      const double step = k > 0 ? record[k].theta_m - record[k - 1].theta_m : 0;
      turned += std::abs(step) < kPi ? step : wrap_pi(step);
      sums[k] = {.theta_m = late.pass(turned) - turned};
    }
  }
  void rotor_speed(Record record, double T_s, Sums sums) const {
    Late<double, LowPass<double>> late(delay(), tau(), T_s);
    for (std::size_t k = 0; k < record.size(); ++k)
      sums[k] = {.omega_m = late.pass(record[k].omega_m) - record[k].omega_m};
  }

  SamplingFacts::Signal signal_ = SamplingFacts::kVoltage;
  Form form_ = kDelay;
  double lag_ = 0;
  double delay_share_ = 0;
};

}  // namespace

std::shared_ptr<Effect> make_signal_lag() {
  return std::make_shared<SignalLag>();
}

}  // namespace twinrate
