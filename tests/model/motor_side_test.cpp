#include "model/effects/motor_side.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <random>
#include <tuple>

namespace twinrate::motor_side_test {

constexpr double kStep_s = 2e-4;

// Oscillations with a load that changes flanks, and the seam of two logs in the middle.
std::vector<OperatingPoint> swings(std::size_t rows) {
  std::vector<OperatingPoint> record(rows);
  for (std::size_t k = 0; k < rows; ++k) {
    const double t = static_cast<double>(k) * kStep_s;
    record[k].t = t + (k >= rows / 2 ? 1.0 : 0.0);
    record[k].theta_m = std::sin(9 * t) + 0.05 * std::sin(140 * t);
    record[k].T_load = 0.4 * std::sin(13 * t);
  }
  return record;
}

std::vector<ShaftFacts> random_gaps(std::size_t count) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> u(0, 1);
  std::vector<ShaftFacts> shafts(count);
  for (ShaftFacts& s : shafts) {
    s.J_load = 0.001 + 0.003 * u(random);
    s.stiffness = 80 + 500 * u(random);
    s.damping = 0.02 + 0.3 * u(random);
    s.gap = 0.004 + 0.03 * u(random);
  }
  return shafts;
}

// A shaft does not depend on the shafts computed in the same register. `tied`: to a torque that
// differs from that of all of them.
void several_equal_each_alone(double tied) {
  const std::vector<OperatingPoint> record = swings(6000);
  MotorSide motor(record, load_behind_shaft({}, record), kStep_s);
  std::vector<MotorSide::Measured> measured(record.size());
  for (std::size_t k = 0; k < measured.size(); ++k)
    measured[k] = {std::sin(record[k].t), 20 * std::cos(record[k].t), k % 7 != 0};
  motor.tie(measured, tied);
  for (std::size_t count : {1, 2, 3, 4, 5, 11}) {
    std::vector<ShaftFacts> shafts = random_gaps(count);
    if (count > 4) {
      shafts[1].gap = 0;
      shafts[2].J_load = 0;
    }
    std::vector<std::vector<double>> together(count);
    motor.along(shafts, together);
    for (std::size_t s = 0; s < count; ++s) {
      std::vector<double> alone(record.size());
      motor.along(shafts[s], alone);
      EXPECT_EQ(together[s], alone) << s << " of " << count;
    }
  }
}

TEST(MotorSide, SeveralShaftsAtOnceEqualEachAlone) {
  several_equal_each_alone(0);
}

TEST(MotorSide, SeveralTiedShaftsAtOnceEqualEachAlone) {
  several_equal_each_alone(0.1);
}

// A stiffness that is wrong by 2 per cent moves every impact, and each moves the next ones.
TEST(MotorSide, ATiedLoadStaysNearTheMeasuredTorque) {
  const std::vector<OperatingPoint> record = swings(20000);
  const std::vector<double> behind(record.size());
  const ShaftFacts truth{.J_load = 0.002, .stiffness = 200, .damping = 0.03, .gap = 0.02};
  ShaftFacts wrong = truth;
  wrong.stiffness *= 1.02;
  MotorSide motor(record, behind, kStep_s);
  std::vector<double> torque(record.size());
  motor.along(truth, torque);
  const auto error = [&] {
    std::vector<double> with(record.size());
    motor.along(wrong, with);
    double sum = 0;
    for (std::size_t k = 0; k < with.size(); ++k) sum += std::pow(with[k] - torque[k], 2);
    return std::sqrt(sum / static_cast<double>(with.size()));
  };
  const double untied = error();
  std::vector<MotorSide::Measured> measured(record.size());
  // The measured torque may be known as a part in proportion to the load's inertia.
  for (std::size_t k = 0; k < record.size(); ++k)
    measured[k] = {torque[k] - 3 * wrong.J_load, 3, true};
  motor.tie(measured, 0.1);
  EXPECT_LT(error(), 0.3 * untied);
  for (MotorSide::Measured& m : measured) m.known = false;
  motor.tie(measured, 0.1);
  EXPECT_EQ(error(), untied);
}

// The shafts of the test above lift off and land.
TEST(MotorSide, FlanksNeverPull) {
  const std::vector<OperatingPoint> record = swings(6000);
  const MotorSide motor(record, std::vector<double>(record.size()), kStep_s);
  for (const ShaftFacts& shaft : random_gaps(4)) {
    std::vector<double> T_load(record.size());
    motor.along(shaft, T_load);
    int upper = 0, lower = 0, free = 0;
    for (double T : T_load) ++(T > 0 ? upper : T < 0 ? lower : free);
    EXPECT_GT(upper, 300);
    EXPECT_GT(lower, 300);
    EXPECT_GT(free, 300);
  }
}

// J_l delta'' + D delta' + K delta = J_l theta_m'' + T_behind, T_shaft = K delta + D delta' in steady
// state at 20 Hz, 250 rows a period. A load that is held from row to row acts half a row later.
// Half a row is 1.3 % here.
TEST(MotorSide, InSteadyStateTheShaftHasTheTorqueOfTheClosedForm) {
  using Complex = std::complex<double>;
  constexpr double kOmega = kTwoPi * 20;
  const ShaftFacts shaft{.J_load = 0.0014, .stiffness = 200, .damping = 0.3};
  const double J = shaft.J_load, K = shaft.stiffness, D = shaft.damping;
  const Complex s(0, kOmega);
  for (const auto& [angle, load, held] :
       {std::tuple{0.01, 0.0, 1.0}, {0.0, 0.2, 0.0}, {0.0, 0.2, 1.0}, {0.01, 0.1, 0.0}}) {
    std::vector<OperatingPoint> record(2000);
    std::vector<double> behind(record.size()), T_load(record.size());
    const auto at = [&](Complex amplitude, std::size_t k) {
      return (amplitude * std::exp(s * (kStep_s * static_cast<double>(k)))).real();
    };
    for (std::size_t k = 0; k < record.size(); ++k) {
      record[k].t = kStep_s * static_cast<double>(k);
      record[k].theta_m = 3 * record[k].t + at(angle, k);
      behind[k] = at(load, k);
    }
    MotorSide(record, behind, kStep_s, held).along(shaft, T_load);
    const Complex acting = load * std::exp(-0.5 * held * kStep_s * s);
    const Complex T = (K + D * s) * (J * s * s * angle + acting) / (J * s * s + D * s + K) - load;
    double most = 0;
    for (std::size_t k = 1500; k + 2 < record.size(); ++k)
      most = std::max(most, std::abs(T_load[k] - at(T, k)));
    EXPECT_LT(most, 2e-3 * (std::abs(T) + load)) << angle << " " << load << " " << held;
  }
}

// A log may begin in motion: the load then accelerates with the motor, and does not ring. A motor
// that starts from rest sets it ringing: J alpha (1 - cos w_0 t).
TEST(MotorSide, ALoadThatMovedBeforeTheFirstRowAcceleratesWithTheMotor) {
  const ShaftFacts shaft{.J_load = 0.0014, .stiffness = 12, .damping = 0};
  const double omega_0 = std::sqrt(shaft.stiffness / shaft.J_load);
  for (const auto& [speed, alpha] :
       {std::pair{30.0, 80.0}, {-30.0, 80.0}, {30.0, -80.0}, {0.0, 80.0}}) {
    std::vector<OperatingPoint> record(3000);
    for (std::size_t k = 0; k < record.size(); ++k) {
      const double t = kStep_s * static_cast<double>(k);
      record[k].t = t + (k < 1500 ? 0 : 1.0);  // and after a seam
      record[k].theta_m = speed * t + 0.5 * alpha * t * t;
    }
    std::vector<double> T_load(record.size());
    MotorSide(record, std::vector<double>(record.size()), kStep_s).along(shaft, T_load);
    const double torque = shaft.J_load * alpha;
    for (std::size_t k = 0; k + 2 < 1500; ++k) {
      const double rings = speed == 0 ? std::cos(omega_0 * record[k].t) : 0;
      ASSERT_NEAR(T_load[k], torque * (1 - rings), 0.02 * std::abs(torque)) << k << " " << speed;
    }
    for (std::size_t k = 1500; k + 2 < record.size(); ++k)
      ASSERT_NEAR(T_load[k], torque, 0.02 * std::abs(torque)) << k << " " << speed;
  }
}

// A constant speed from a 20-bit encoder gives a constant load speed. The last digit between the
// first two rows is 0.06 rad/s; a shaft of 59 Hz rang with 0.01 Nm for 0.1 s because of it.
TEST(MotorSide, TheEncodersLastDigitCausesNoRinging) {
  constexpr double kDigit = kTwoPi / 1048576, kTs_s = 1e-4;
  const ShaftFacts shaft{.J_load = 0.0014, .stiffness = 190, .damping = 0.02};
  for (double omega_m : {0.1, 0.3, 1.0, 3.0}) {
    std::vector<OperatingPoint> record(4000);
    for (std::size_t k = 0; k < record.size(); ++k) {
      record[k].t = kTs_s * static_cast<double>(k) + (k < 2000 ? 0 : 1.0);  // and after a seam
      record[k].theta_m =
          kDigit * std::floor((0.00001 + omega_m * kTs_s * static_cast<double>(k)) / kDigit);
    }
    std::vector<double> T_load(record.size());
    MotorSide(record, std::vector<double>(record.size()), kTs_s).along(shaft, T_load);
    double most = 0;  // of a moving mean: the digit itself shakes the shaft
    for (std::size_t k = 0; k + 20 < record.size(); ++k) {
      double sum = 0;
      for (std::size_t j = 0; j < 20; ++j) sum += T_load[k + j];
      most = std::max(most, std::abs(sum / 20));
    }
    EXPECT_LT(most, 0.006) << omega_m;
  }
}

}  // namespace twinrate::motor_side_test
