// The common findings from position logs, and the fall of their error.
//
// The error is that of the speed's change over a horizon if any judged log moves freely, else that
// of the current that holds the rotor.
#pragma once
#include <cmath>
#include <limits>

#include "trace/hooks.hpp"
#include "trace/motion.hpp"
#include "trace/winding_voltage.hpp"

namespace twinrate {

// An error for which there are no data.
inline constexpr double kNoError = std::numeric_limits<double>::quiet_NaN();

using Logs = std::vector<const PositionLog*>;

// Everything that the logs gave, before it becomes text.
// Change of the friction from standstill to the fastest rows in which the current holds the rotor,
// as a share of its size at standstill.
struct FrictionSlope {
  double change = 0, sigma = 0;
  // A Coulomb friction does not fall; the viscous friction of the drive file may be too large by a
  // tenth of it.
  bool falls() const { return change < -0.1 && change < -5 * sigma; }
};

struct Found {
  const MachineParameters& machine;
  Logs at_rest, in_motion;  // that train
  HoldingTorque holding;
  SpinUp spin;
  FrictionSlope friction_slope;
  bool lag_is_of_current = false;
  SpeedLag speed_lag;
  WindingVoltage voltage;                         // of all rows that train
  WindingVoltage voltage_fitted, voltage_unseen;  // of rows that do not judge; of those that judge

  double gain() const { return spin.gain > 0 ? spin.gain : machine.torque_constant() / machine.J; }
  double J() const { return machine.torque_constant() / gain(); }
  double T_C() const { return holding.both_directions ? holding.T_C : spin.T_C; }
  double sigma_T_C() const { return holding.both_directions ? holding.sigma_T_C : spin.sigma_T_C; }
  MotionModel declared() const { return {.gain = gain(), .B = machine.B, .machine = machine}; }
  MotionModel model() const {
    MotionModel m = declared();
    m.holding = &holding;
    m.T_C = T_C();
    m.speed_lag = speed_lag;
    return m;
  }
};

// Sums of squares over logs, rms at the end.
struct Errors {
  double no_change = 0, before = 0, after = 0, rows = 0;
  void add(double nothing, double declared, double found, double n) {
    no_change += n * nothing * nothing;
    before += n * declared * declared;
    after += n * found * found;
    rows += n;
  }
  static double rms(double sum, double n) {
    return n > 0 ? std::sqrt(sum / n) : std::numeric_limits<double>::quiet_NaN();
  }
};

class Judge {
 public:
  // After a stop every error is kNoError.
  Judge(const std::vector<PositionLog>& logs, const MachineParameters& machine, double horizon,
        const TraceHooks& hooks);
  // Finds training runs that a traced cogging makes worse: their angle has another zero, so the
  // phase of the cogging is unknown there. A held-out run gets no such exception.
  void find_other_zeros(const Found& found);
  const Logs& other_zero() const { return other_zero_; }
  bool by_speed() const { return by_speed_; }
  double horizon() const { return horizon_; }
  const Logs& logs() const { return logs_; }
  // True if there are judging rows that no fit has seen.
  bool unseen() const;

  // Adds the errors of a log. `unseen`: over its judging rows (true) or its other rows (false), if
  // it has both.
  void add(const PositionLog& log, bool unseen, const Found& declared_of, const MotionModel& model,
           Errors& errors) const;
  Errors over(const Found& found, const MotionModel& model, bool held_out) const;
  // Held-out error, or that of the training logs if none is held out.
  double error(const Found& found, const MotionModel& model) const;
  // 1/2 ln(E without / E with) over the same logs, for each piece on which the two models differ
  // (trace/gate.hpp); 24 pieces a log.
  std::vector<double> votes(const Found& found, const MotionModel& with, const MotionModel& without,
                            double silent) const;

 private:
  // Residual of the model in each row, in order.
  std::vector<double> rest(const PositionLog& log, const Found& found,
                           const MotionModel& model) const;
  const TraceHooks& hooks_;
  double horizon_;
  bool by_speed_ = false;
  Logs logs_, other_zero_;
};

}  // namespace twinrate
