// The drive's equations as residuals of a record, under any set of effects.
//
//   voltage  e = u - R_s i - (psi_{k+1} - psi_k)/T_s - drops,   stator axes, mean over one interval
//            (what acts less than asked for, of the interval itself), then turned into rotor axes
//            at mid-interval
//   torque   e = T_em - T_load - B omega_m - J omega_m' - effects,   omega_m' = second difference
//
// Means are to the third order. What goes by the angle is a cubic between rows; its mean over an
// interval, m_k the mean of both ends, and that of a torque, over the triangle by which a second
// difference weighs omega_m':
//
//   angle    m_k - (m_{k-1} - 2 m_k + m_{k+1})/12
//   torque   x_k + (x_{k-1} - 2 x_k + x_{k+1})/12
//
// A current is no cubic: its voltage is held for T while the magnets turn, and it decays. Its mean
// from one sample of the controller to the next is that of both ends and a part along d and q:
//
//   L i''    = -R_s i' - psi_m''
//   current  m_k - T^2 omega_e^2 psi_f/(12 L_d) along d + R_s T/(12 L) (i_{k+1} - i_k)
//
// Over several of them in a row there is a cubic's, too, 1 - (T/T_s)^2 of it. In rotor axes the chord between
// the samples turns back and forth; a torque takes the mean of that, too:
//
//   current  i_dq (1 - (omega_e T)^2/12) - T^2 omega_e^2 psi_f/(12 L_d) along d
//
// A load that is set, and held for T, too, is taken at T/2 before its row; a load that was measured, as it is.
//
// No derivative of a noisy signal is taken alone; what is noisy here is smoothed by the Sampler
// (trace/sampler.hpp), residual and regressors alike. Effects on sensors are undone first, so one
// parameter acts on all equations at once. Residuals are in V and Nm.
#pragma once
#include <memory>
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
  std::vector<double> d, q;  // V; empty where not concerned
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
  // `known`: effects that the declared model has already. `considered`: what it may lack.
  Equations(const Record& record, const DriveFacts& facts, Effects known = {},
            Considered considered = {});

  // What is left of the equations with `effects` in the model, besides those known. The record less
  // their sensors' errors may be kept for the next residual with the same ones.
  enum class Undone { kForgotten, kKept };
  Channels residual(const Effects& effects, Undone undone = Undone::kForgotten) const;
  // How much each linear regressor of an effect explains: residual(without) = coefficient * column.
  std::vector<Channels> columns(const Effect& effect) const;
  // The same of an effect that adds to the load alone: its torque at every stride-th row from
  // `first` on, by regressor.
  std::vector<std::vector<double>> load_columns(const Effect& effect, std::size_t first,
                                                std::size_t stride) const;
  // The same for an effect without regressors: its whole contribution as it stands.
  Channels contribution(const Effect& effect) const;
  // The record as it was before the sensors' errors among `effects`.
  Record without_errors(const Effects& effects) const;
  // Considered, its numbers within their ranges, and, beside what is known, a drive that there may
  // be.
  bool possible(const Effect& effect) const;
  bool has_voltage() const { return record_.has_voltage_equation(); }
  // The log has no i_d, and the effect shows by it alone: a flux that depends on the current, or, where a
  // reluctance has a torque, what turns the current's axes.
  bool needs_missing_i_d(const Effect& effect) const;
  const Record& record() const { return record_; }
  const Effects& known() const { return known_; }
  const Considered& considered() const { return considered_; }
  const DriveFacts& facts() const { return facts_; }
  // Smoothed speed of the record as it is.
  const std::vector<double>& omega_m() const { return omega_m_; }
  const std::vector<OperatingPoint>& points() const { return points_; }

 private:
  // Unit vectors of the d axis: at row k, and half-way to it from the row before.
  struct Axes {
    std::vector<Vec2> at, mid;
  };
  // What the equations are written in.
  struct Signals {
    std::vector<Vec2> i_alphabeta, i_dq;
    std::vector<double> theta_m;
    std::shared_ptr<const Axes> axes;
  };
  void turn_currents(Signals& s) const;  // i_dq from the others
  void turn_angle(Signals& s) const;     // the axes
  // Points to where the signals have moved them.
  void move_points(const Signals& s, bool angle_moved, std::vector<OperatingPoint>& points) const;
  // The record less what the sensing effects among `effects` added to it, seen at `points`.
  Signals undo_sensing(const Effects& effects, const std::vector<OperatingPoint>& points) const;
  // The same seen where the record then stands, and those points.
  struct UndoneSensing {
    std::vector<std::pair<std::string_view, std::vector<double>>> errors;  // kinds and keys
    Signals signals;
    std::vector<OperatingPoint> points;
  };
  UndoneSensing true_signals(const Effects& sensing) const;
  double omega_rate(const Signals& s, std::size_t k) const;   // omega_m'
  Vec2 mean_of_tick(const Vec2& i_dq, double omega_m) const;  // of the current that a torque takes
  Channels assemble(const Signals& s, const Effects& effects,
                    const std::vector<OperatingPoint>& points) const;
  Channels residual_of(const Effects& effects, Undone undone = Undone::kForgotten) const;
  Channels empty(int acts_on) const;
  // What contribution c explains at row k, given what the rows before said.
  struct Before {
    Vec2 psi = Vec2::Zero(), drop = Vec2::Zero();
    Bend<Vec2> mean{Vec2::Zero()};
    Bend<double> torque{0};
  };
  struct Mean {
    bool of_command = false;  // of the interval itself
    double bent = 0;          // how much of a cubic's
  };
  Mean mean_of(const Effect& effect) const;
  void explain(std::size_t k, const Contribution& c, Mean how, Channels& x, Before& before) const;

  const Record& record_;
  DriveFacts facts_;
  Effects known_;
  Considered considered_;
  double T_held_ = 0;     // s, for which a voltage stands
  double bent_ = 0;       // of a current's mean, the share that is a cubic's
  double load_held_ = 0;  // of T_s, for which a load stands
  Signals measured_;
  std::vector<double> omega_m_;
  std::vector<OperatingPoint> points_;
  Channels base_;
  mutable UndoneSensing undone_;            // kept
  mutable std::optional<MotorSide> motor_;  // of the record as it is, made for the first shaft
};

}  // namespace twinrate
