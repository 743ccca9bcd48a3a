// The drive's equations as residuals of a record, under any set of effects.
//
//   voltage  e = u - R_s i - (psi_{k+1} - psi_k)/T_s - drops,   stator axes, mean over one interval
//            (an error of the commanded voltage has the value of the interval itself), then turned
//            into rotor axes at mid-interval
//   torque   e = T_em - T_load - B omega_m - J omega_m' - effects,   omega_m' = second difference
//
// Means are exact to the third order. A signal that depends on the angle is a cubic between rows.
// With m_k the mean of both ends, its mean over an interval, and the mean of a torque over the
// triangle with which a second difference weighs omega_m', are
//
//   angle    m_k - (m_{k-1} - 2 m_k + m_{k+1})/12
//   torque   x_k + (x_{k-1} - 2 x_k + x_{k+1})/12
//
// A current is no cubic: its voltage is held for T while the magnets turn, and the current decays.
// Its mean from one sample of the controller to the next is the mean of both ends plus a part along
// d and q:
//
//   L i''    = -R_s i' - psi_m''
//   current  m_k - T^2 omega_e^2 psi_f/(12 L_d) along d + R_s T/(12 L) (i_{k+1} - i_k)
//
// The mean over several such intervals also has the term of a cubic, multiplied by 1 - (T/T_s)^2.
// In rotor axes the chord between the samples turns back and forth. A torque depends on the mean of
// this motion:
//
//   current  i_dq (1 - (omega_e T)^2/12) - T^2 omega_e^2 psi_f/(12 L_d) along d
//              + R_s T^2 omega_e/12 (-i_q/L_d, i_d/L_q)
//
// A drop that bends where a current changes its sign (dead time, switches) is its mean along the
// path of this mean current, whose parts are straight in stator axes
// (trace/record_contributions.hpp). The ripple that such a drop makes is in the path; the noise of
// the readings is smoothed.
//
// A load that is set and held for T is taken at T/2 before its row; a measured load at its row.
//
// No derivative of a noisy signal is used alone: the Sampler (trace/sampler.hpp) smooths residual
// and regressors alike. Effects on sensors are removed first, so one parameter acts on all
// equations at once. Residuals are in V and Nm.
#pragma once
#include <memory>
#include <mutex>
#include <optional>
#include <string_view>
#include <utility>
#include <vector>

#include "model/drive_facts.hpp"
#include "model/effects/motor_side.hpp"
#include "trace/considered.hpp"
#include "trace/record.hpp"

namespace twinrate {

struct Channels {
  std::vector<double> d, q;  // V; empty if not affected
  std::vector<double> torque;
};

// The second difference of a sequence at the value before the last.
template <class Value>
class Bend {
 public:
  explicit Bend(const Value& zero) : before_(zero), last_(zero) {}
  Value pass(const Value& x) {
    const Value bend = before_ - 2 * last_ + x;
    before_ = last_;
    last_ = x;
    return bend;
  }

 private:
  Value before_, last_;
};

class Equations {
 public:
  // `known`: effects of the declared model. `considered`: kinds that it may lack.
  Equations(const Record& record, const DriveFacts& facts, Effects known = {},
            Considered considered = {});

  // Residual with `effects` in the model, besides the known ones. The record without the sensor
  // errors can be kept for the next residual with the same errors.
  enum class Undone { kForgotten, kKept };
  Channels residual(const Effects& effects, Undone undone = Undone::kForgotten) const;
  // Contribution of one unit of each linear regressor: residual(without) = coefficient * column.
  std::vector<Channels> columns(const Effect& effect) const;
  // The same for an effect that acts on the load alone: its torque at every stride-th row from
  // `first` on, by regressor.
  std::vector<std::vector<double>> load_columns(const Effect& effect, std::size_t first,
                                                std::size_t stride) const;
  // The same for an effect without regressors: its whole contribution.
  Channels contribution(const Effect& effect) const;
  // The record without the sensor errors among `effects`.
  Record without_errors(const Effects& effects) const;
  // True if the effect is considered, its numbers are within their ranges, and the drive with it
  // and the known effects is physically possible.
  bool possible(const Effect& effect) const;
  bool has_voltage() const { return record_.has_voltage_equation(); }
  // True if the log has no i_d and the effect shows only through it: a flux that depends on the
  // current or, in a machine with reluctance torque, an effect that turns the current's axes.
  bool needs_missing_i_d(const Effect& effect) const;
  const Record& record() const { return record_; }
  const Effects& known() const { return known_; }
  const Considered& considered() const { return considered_; }
  const DriveFacts& facts() const { return facts_; }
  // Smoothed speed of the record as measured.
  const std::vector<double>& omega_m() const { return omega_m_; }
  const std::vector<OperatingPoint>& points() const { return points_; }

 private:
  // Unit vectors of the d axis: at row k, and halfway from row k-1 to row k.
  struct Axes {
    std::vector<Vec2> at, mid;
  };
  // The signals in the equations.
  struct Signals {
    std::vector<Vec2> i_alphabeta, i_dq;
    std::vector<double> theta_m;
    std::shared_ptr<const Axes> axes;
  };
  void turn_currents(Signals& s) const;  // i_dq from i_alphabeta and the axes
  void turn_angle(Signals& s) const;     // the axes from theta_m
  // Moves the points to the corrected signals.
  void move_points(const Signals& s, bool angle_moved, std::vector<OperatingPoint>& points) const;
  // The record less the errors of the sensing effects among `effects`, evaluated at `points`.
  Signals undo_sensing(const Effects& effects, const std::vector<OperatingPoint>& points) const;
  // The same with the errors evaluated at the corrected points, and these points.
  struct UndoneSensing {
    std::vector<std::pair<std::string_view, std::vector<double>>> errors;  // kinds and keys
    Signals signals;
    std::vector<OperatingPoint> points;
  };
  UndoneSensing true_signals(const Effects& sensing) const;
  double omega_rate(const Signals& s, std::size_t k) const;  // omega_m'
  Vec2 ripple_share(const std::vector<Vec2>& i_smoothed) const;
  Vec2 mean_of_tick(const Vec2& i_dq, double omega_m) const;  // current that makes the torque
  // The currents for drops that follow them, mean of a tick. They keep the ripple that the drop
  // itself makes, which a smoothed current lacks.
  std::vector<Vec2> path_currents(const Signals& s,
                                  const std::vector<OperatingPoint>& points) const;
  Channels assemble(const Signals& s, const Effects& effects,
                    const std::vector<OperatingPoint>& points) const;
  Channels residual_of(const Effects& effects, Undone undone = Undone::kForgotten) const;
  Channels empty(int acts_on) const;
  // Adds contribution c of row k to x; `before` holds the values of the rows before.
  struct Before {
    Vec2 psi = Vec2::Zero(), drop = Vec2::Zero();
    Bend<Vec2> mean{Vec2::Zero()};
    Bend<double> torque{0};
  };
  struct Mean {
    bool of_interval = false;  // of the interval itself
    double bent = 0;           // share of a cubic's term
  };
  Mean mean_of(const Effect& effect) const;
  void explain(std::size_t k, const Contribution& c, Mean how, Channels& x, Before& before) const;

  const Record& record_;
  DriveFacts facts_;
  Effects known_;
  Considered considered_;
  double T_held_ = 0;           // s, for which a voltage is held
  double bent_ = 0;             // share of a cubic's term in the mean of a current
  double load_held_ = 0;        // for which a load is held, over T_s
  Vec2 ripple_ = Vec2::Zero();  // share of ripple in what smoothing takes from the currents
  Signals measured_;
  std::vector<double> omega_m_;
  std::vector<OperatingPoint> points_;
  Channels base_;
  mutable std::shared_ptr<const UndoneSensing> undone_;  // the kept one
  mutable std::mutex undone_mutex_;
  mutable std::optional<MotorSide> motor_;  // of the record as measured; made for the first shaft
  mutable std::mutex motor_mutex_;
};

}  // namespace twinrate
