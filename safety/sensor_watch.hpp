// Sensor readings that a healthy sensor cannot give, and their replacement.
//
//   not finite       NaN or infinite
//   jump, currents   |i - i_predicted| > kJumpMargin (T_s/L (|u| + psi_f |omega_e| + R_s |i|
//                                                     + v_floor) + |omega_e| T_s L_ratio |i|)
//                                        + i_floor
//   sum, currents    |i_a + i_b + i_c| > i_sum with three sensors
//   stuck, currents  one reading does not change at all while the currents' frame turns 2 rad and
//                    another phase moves by i_moved; or none of them changes over a whole turn at
//                    an amplitude above half of i_moved
//   jump, position   |theta_m - theta_m predicted| > step_max
//
// i_predicted is the last good current, constant in rotor axes: turned by the angle by which the
// voltage's frame has turned since. L is the smaller inductance, L_ratio the larger over the
// smaller one. The bounds are the largest changes of the current by voltage, EMF and resistance
// within one tick, with a margin: a jump below them is not detected here. It changes the current
// that the controller uses, and trips as an over-current, or not at all.
//
// A faulty reading is replaced by its prediction until a reading within the bound comes back; the
// bus voltage and the speed by their last good value. check() once a tick.
#pragma once
#include <array>

namespace twinrate {

enum ReadingFault : int {
  kCurrentsNotFinite = 1,
  kCurrentsJump = 2,
  kCurrentsStuck = 4,
  kBusNotFinite = 8,
  kPositionNotFinite = 16,
  kPositionJump = 32,
  kRowMissing = 64,  // no sample at all
};
inline constexpr int kAnyCurrentFault = kCurrentsNotFinite | kCurrentsJump | kCurrentsStuck;
inline constexpr int kAnyPositionFault = kPositionNotFinite | kPositionJump;

struct SensorLimits {
  double T_s = 0;
  double L = 0, L_ratio = 1, R_s = 0, psi_f = 0;
  int n_p = 1;
  double v_floor = 0;   // V: dead time, drops, a bus that moves
  double i_floor = 0;   // A: noise and steps of the ADC
  double i_sum = 0;     // A; 0: the third current is made up from two
  double i_moved = 0;   // A
  double step_max = 0;  // rad of theta_m in one tick
};

struct SensorReadings {
  std::array<double, 3> i_abc{};
  double v_dc = 0, theta_m = 0, omega_m = 0;
};

// Actions of the drive over the interval that ends with the readings.
struct AppliedVoltage {
  double u = 0;        // amplitude, V
  double theta_e = 0;  // angle of the frame that the command's currents were turned with
};

class SensorWatch {
 public:
  static constexpr double kJumpMargin = 1.5;

  explicit SensorWatch(const SensorLimits& limits) : limits_(limits) {}

  // Sum of ReadingFault; faulty readings are replaced. `measured` false: a row without a sample.
  int check(SensorReadings& readings, const AppliedVoltage& applied, bool measured = true);

 private:
  using Currents = std::array<double, 3>;
  struct Vector {
    double alpha = 0, beta = 0;
    double norm() const;
    Currents phases() const;
  };
  static Vector vector_of(const Currents& i);
  Vector predicted_current(double turned) const;
  double jump_bound(const AppliedVoltage& applied, double turned, const Vector& i) const;
  int check_currents(Currents& i, const AppliedVoltage& applied, double turned);
  bool stuck(const Currents& i, double turned);
  int check_position(SensorReadings& readings);

  SensorLimits limits_;
  bool begun_ = false;
  SensorReadings good_;
  double theta_e_ = 0, u_before_ = 0, omega_e_ = 0;
  Currents raw_{};                                    // the last readings as they came
  std::array<double, 3> turned_same_{};               // by the phases, since they changed
  std::array<std::array<double, 2>, 3> at_change_{};  // of the other two phases, then
};

}  // namespace twinrate
