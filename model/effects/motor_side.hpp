// The motor's motion as the input of a load mass behind its shaft along a record, computed once for
// any number of shafts.
#pragma once
#include <span>
#include <vector>

#include "model/effects/shaft.hpp"

namespace twinrate {

class MotorSide {
 public:
  // `behind`: the load behind the shaft at each point, T_s apart, held from the point on for the
  // share `held` of T_s; 0: the load at the point.
  MotorSide(std::span<const OperatingPoint> record, std::vector<double> behind, double T_s,
            double held = 1);
  std::size_t rows() const { return rows_.size(); }

  struct Row {
    double omega_m = 0;                // of the motor
    double begin = 0, omega_rate = 0;  // its speed and acceleration from there to the next
    double behind = 0, held = 0;       // load at the row; from there to the next
    double torque = 0, torque_per_inertia = 0, tied = 0;  // see tie()
  };

  // The torque in the shaft as measured from the motor's side, where `known`: torque +
  // torque_per_inertia J_load. Tied, the load follows it: at each row the twist moves towards the
  // twist of that torque, with `damping` times the critical damping. Not tied (0), an error of one
  // impact changes all later ones, and the error of a shaft with a gap is a rugged function of its
  // keys.
  struct Measured {
    double torque = 0, torque_per_inertia = 0;  // Nm, rad/s2
    bool known = false;
  };
  // `measured`: of each row.
  void tie(std::span<const Measured> measured, double damping);

  // T_load of along_shaft().
  void along(const ShaftFacts& shaft, std::span<double> T_load) const;
  // The same for several at once, a vector of rows() numbers each: bit for bit the result of
  // along().
  void along(std::span<const ShaftFacts> shafts, std::span<std::vector<double>> T_load) const;
  // The load mass itself at each row; of a shaft with one.
  std::vector<ShaftState> load_mass(const ShaftFacts& shaft) const;

 private:
  void four(const ShaftFacts* shafts, double* const* T_load) const;
  void eight(const ShaftFacts* shafts, double* const* T_load) const;
  void portable(const ShaftFacts* shafts, std::size_t count, double* const* T_load) const;
  void avx2(const ShaftFacts* shafts, std::size_t count, double* const* T_load) const;

  double T_s_, tie_ = 0;
  std::vector<Row> rows_;
  // Start of another stretch of time. The earlier motion of the load is unknown: it is assumed at
  // rest against the motor, and to accelerate with a motor that has been moving for longer.
  struct Start {
    struct Motion {
      double seconds = 0, omega_m = 0, omega_rate = 0, jerk = 0;  // rad/s3
      bool moved = false;                                         // before the first row
    };
    std::size_t row = 0;
    double omega_m = 0;
    std::vector<Motion> over;  // ever longer times, by a cubic polynomial through the angle
  };
  Start start_at(std::span<const OperatingPoint> record, std::span<const double> mean,
                 std::size_t row) const;
  ShaftState at_start(const ShaftFacts& shaft, const Start& start) const;
  std::vector<Start> starts_;
};

}  // namespace twinrate
