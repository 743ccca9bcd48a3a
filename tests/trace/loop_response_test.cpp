#include "trace/loop_response.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "model/random.hpp"
#include "tests/support/effects.hpp"
#include "trace/noise.hpp"
#include "trace/residual_structure.hpp"
#include "trace/tracer.hpp"

namespace twinrate {
namespace {

constexpr double kT_s = 1e-4, kGain = 20;  // s, V/A
constexpr std::size_t kRows = 30000, kMean = 12;

MachineParameters winding() {
  MachineParameters m;
  m.n_p = 3;
  m.R_s = 1.05;
  m.L_d = m.L_q = 12.7e-3;
  m.psi_f = 0.25;
  m.J = 1e3;  // the rotor does not answer
  return m;
}

std::vector<Vec2> noise(std::uint64_t seed) {
  std::vector<Vec2> n;
  for (std::size_t k = 0; k < kRows; ++k)
    n.push_back(0.01 * Vec2(normal(seed, 0, k), normal(seed, 1, k)));
  return n;
}

// A drive with a proportional current controller, one sample of delay and noise; reference zero or
// an oscillation of `swing_A`.
Record noisy_drive(double gain, double R_more = 0, double swing_A = 0) {
  const MachineParameters m = winding();
  const double R = m.R_s + R_more, kept = std::exp(-kT_s * R / m.L_d);
  const std::vector<Vec2> n = noise(7);
  Record r;
  r.T_s = kT_s;
  Vec2 i = Vec2::Zero(), before = Vec2::Zero();
  for (std::size_t k = 0; k < kRows; ++k) {
    const double phase = kTwoPi * 3 * kT_s * static_cast<double>(k);
    const Vec2 u = gain * (swing_A * Vec2(std::sin(phase), std::cos(phase)) - before);
    before = n[k] + i;
    const double theta_m = 1e-4 * static_cast<double>(k), theta_e = m.n_p * theta_m;
    r.t.push_back(kT_s * static_cast<double>(k));
    r.theta_m.push_back(theta_m);
    r.i_alphabeta.push_back(inverse_park(before, theta_e));
    r.u_alphabeta.push_back(inverse_park(u, theta_e));
    i = kept * i + (1 - kept) / R * u;
  }
  r.electrical_ok.assign(kRows, 1);
  r.motion_ok.assign(kRows, 1);
  return r;
}

// Rms of means over kMean rows: the part below the controller's bandwidth.
double slow_rms(const std::vector<Vec2>& x) {
  double sum = 0, count = 0;
  for (std::size_t first = 100; first + kMean < x.size(); first += kMean) {
    Vec2 mean = Vec2::Zero();
    for (std::size_t j = 0; j < kMean; ++j) mean += x[first + j] / static_cast<double>(kMean);
    sum += mean.squaredNorm();
    ++count;
  }
  return std::sqrt(sum / count);
}

std::vector<Vec2> added(const Record& before, const SensorNoise& noise) {
  Record after = before;
  LoopResponse(before, winding()).add(noise, after);
  std::vector<Vec2> x;
  for (std::size_t k = 0; k < before.size(); ++k)
    x.push_back(after.i_alphabeta[k] - before.i_alphabeta[k]);
  return x;
}

TEST(LoopResponse, MakesNoiseAsQuietAsTheControllerDoes) {
  const Record r = noisy_drive(kGain);
  const SensorNoise n{.i_alphabeta = noise(8), .theta_m = std::vector<double>(kRows, 0.0)};
  const double recorded = slow_rms(r.i_alphabeta);
  EXPECT_LT(recorded, 0.8 * slow_rms(n.i_alphabeta));  // the loop matters
  EXPECT_NEAR(slow_rms(added(r, n)), recorded, 0.06 * recorded);
}

// Blocks of a long log stand one behind the other: the angle jumps between them, the rotor does not.
TEST(LoopResponse, DoesNotTakeASeamForAFastTurn) {
  Record r = noisy_drive(kGain);
  const SensorNoise n{.i_alphabeta = noise(8), .theta_m = std::vector<double>(kRows, 0.0)};
  const double without = slow_rms(added(r, n));
  for (std::size_t k = kRows / 2; k < kRows; ++k) r.theta_m[k] += 400 * kTwoPi;  // whole turns
  r.electrical_ok[kRows / 2] = r.motion_ok[kRows / 2] = 0;
  EXPECT_NEAR(slow_rms(added(r, n)), without, 0.01 * without);
}

TEST(LoopResponse, LeavesNoiseAloneInAnOpenLoop) {
  Record r = noisy_drive(0);
  for (std::size_t k = 0; k < kRows; ++k)  // a voltage independent of the currents
    r.u_alphabeta[k] = {normal(9, 0, k), normal(9, 1, k)};
  const SensorNoise n{.i_alphabeta = noise(8), .theta_m = std::vector<double>(kRows, 0.0)};
  EXPECT_NEAR(slow_rms(added(r, n)), slow_rms(n.i_alphabeta), 0.05 * slow_rms(n.i_alphabeta));
}

// A gain beyond the stability limit cannot be that of the drive: only the noise is added.
TEST(LoopResponse, FallsBackToTheNoiseWhereTheLoopIsNotStable) {
  Record r = noisy_drive(kGain);
  for (std::size_t k = 1; k < kRows; ++k) r.u_alphabeta[k] = -3000 * r.i_alphabeta[k - 1];
  const SensorNoise n{.i_alphabeta = noise(8), .theta_m = std::vector<double>(kRows, 0.0)};
  const std::vector<Vec2> x = added(r, n);
  for (std::size_t k = 0; k < kRows; ++k)
    ASSERT_NEAR((x[k] - n.i_alphabeta[k]).norm(), 0, 1e-12) << k;
}

// A record of that drive with the inputs of the tracer's chain.
struct NoisyEquations {
  explicit NoisyEquations(Record r) : record(std::move(r)) {}
  NoisyEquations(const NoisyEquations&) = delete;  // its members refer to each other

  Record record;
  DriveFacts facts{.machine = winding(), .v_dc = 300, .f_pwm = 1 / kT_s};
  Equations equations{record, facts};
  std::vector<char> moving = moving_rows(equations.record());
  Sampler sampler{record, moving, held_out_rows(record, 0.25, facts.machine.n_p)};
  NoisierRecords noisier = add_noise(record, facts, moving, 0);
  Equations answered{noisier.answered, facts}, readings{noisier.readings, facts};
};

// As with a dead time around zero current: the response of the drive contains the 30 Ohm, the model
// for the noise does not.
TEST(LoopResponse, IsNotInTheResidualOfAModelThatIsRight) {
  const NoisyEquations e(noisy_drive(kGain, 30));
  const Chain chain(e.equations, e.answered, e.readings, e.sampler);
  const Sampled y = chain.residual({test::effect_of("resistance", {{"change_Ohm", 30}}, e.facts)});
  EXPECT_NEAR(y.noise_d.norm() / y.d.norm(), 1, 0.05);
}

// With 30 Ohm the residual is the noise of the currents and depends on the noisy currents.
TEST(Rest, DependsOnNoCurrentForItsNoise) {
  constexpr double kMore = 30, kSwing = 0.1;  // ohm, A
  const NoisyEquations e(noisy_drive(kGain, kMore, kSwing));
  Chain chain(e.equations, e.answered, e.readings, e.sampler);
  const auto with = [&](double more) {
    return test::effect_of("resistance", {{"change_Ohm", more}}, e.facts);
  };
  chain.set_noise(NoiseFit()(chain, chain.residual({with(kMore)}), {}));
  const Rows rows(e.sampler, false), held_out(e.sampler, true);
  const Fitter fitter(chain, rows, held_out);
  const auto of_voltage = [&](double more) {  // the drive has no motion
    const std::vector<Structure> found = residual_structure(fitter, fitter.start({with(more)}));
    return std::count_if(found.begin(), found.end(),
                         [](const Structure& s) { return s.equation == "electrical"; });
  };
  EXPECT_EQ(of_voltage(kMore), 0);
  EXPECT_GT(of_voltage(0.7 * kMore), 0);
}

// A large part of the current is the response of the drive to the noise in the residual: this
// correlation must not bias the result.
TEST(LoopResponse, DoesNotBendAResistance) {
  constexpr double kMore = 1, kSwing = 0.002;  // ohm, A
  const NoisyEquations e(noisy_drive(kGain, kMore, kSwing));
  const auto resistance = test::effect_of("resistance", {{"change_Ohm", kMore}}, e.facts);
  const Rows rows(e.sampler, false), held_out(e.sampler, true);
  const auto found = [&](const Equations& by_drive) {
    Chain chain(e.equations, by_drive, e.readings, e.sampler);
    chain.set_noise(NoiseFit()(chain, chain.residual({resistance}), {}));
    const Sampled x = chain.whitened(chain.columns(*resistance)[0]),
                  y = chain.whitened(chain.residual({}));
    const double b = rows.against(x, y), A = rows.dot(x, x), change = b / A;
    // A fit reduces the residual as predicted by the products, up to the uncertainty.
    const Fitter fitter(chain, rows, held_out);
    const auto fitted = test::effect_of("resistance", {{"change_Ohm", change}}, e.facts);
    const double doubt = 0.1 * std::abs(change * change * rows.noise(x, x).sum() -
                                        2 * change * rows.noise_against(x, y).sum());
    EXPECT_NEAR(fitter.start({}).rss - fitter.start({fitted}).rss, b * change - doubt,
                0.1 * b * change + 1);
    return change;
  };
  EXPECT_NEAR(found(e.answered), kMore, 0.2 * kMore);
  EXPECT_LT(found(e.readings), 0.5 * kMore);
}

// The response of the drive moves the motor, and a lightly damped shaft rings: this is neither an
// error of a reading nor noise of the shaft's regressor.
TEST(LoopResponse, SetsAShaftRingingTruly) {
  Record r = noisy_drive(kGain);
  Record moved = r;
  for (std::size_t k = 0; k < kRows; ++k) {
    const double t = r.t[k], motion = 0.05 * std::sin(kTwoPi * 3 * t);
    r.theta_m[k] += motion;
    moved.theta_m[k] += motion + 1e-3 * std::sin(kTwoPi * 15.9 * t);
  }
  const DriveFacts facts{.machine = winding(), .v_dc = 300, .f_pwm = 1 / kT_s};
  const auto torsion = test::effect_of(
      "torsion", {{"J_load_kgm2", 2e-3}, {"stiffness_Nm_rad", 20}, {"damping_Nms_rad", 5e-3}},
      facts);
  const Equations equations(r, facts), answered(moved, facts);
  const Sampler sampler(r, moving_rows(r), held_out_rows(r, 0.25, facts.machine.n_p));
  const Sampled x = Chain(equations, answered, equations, sampler).contribution(*torsion);
  EXPECT_LT(x.noise_torque.norm(), 1e-9 * x.torque.norm());
  EXPECT_GT(x.answer_torque.norm(), 0.3 * x.torque.norm());
}

// No row that fits makes an output, but rows that judge do.
TEST(Rest, IsNotLookedAtInAChannelWithoutANoiseModel) {
  const NoisyEquations e(noisy_drive(kGain, 30, 0.1));
  Chain chain(e.equations, e.answered, e.readings, e.sampler);
  NoiseModel noise = NoiseFit()(chain, chain.residual({}), {});
  noise.q = Whitener();
  chain.set_noise(std::move(noise));
  const Sampled y = chain.whitened(chain.residual({}));
  EXPECT_GT(y.d.size(), 0);
  EXPECT_EQ(y.q.size() + y.noise_q.size() + y.answer_q.size(), 0);
  const Rows rows(e.sampler, false), held_out(e.sampler, true);
  const Fitter fitter(chain, rows, held_out);
  for (const Structure& s : residual_structure(fitter, fitter.start({}))) EXPECT_NE(s.channel, "q");
}

// A resistance that only the fitted rows have predicts none of those that judge; beside a claim of
// another equation as well as alone.
TEST(Rest, OfFittedRowsAloneIsNoStructure) {
  constexpr double kSwing = 0.1, kUnknown = 9;  // A, ohm
  for (const bool everywhere : {true, false}) {
    Record r = noisy_drive(kGain, 0, kSwing);
    const std::vector<char> judges = held_out_rows(r, 0.25, winding().n_p);
    for (std::size_t k = 0; k < r.size(); ++k)
      if (everywhere || !judges[k]) r.u_alphabeta[k] += kUnknown * r.i_alphabeta[k];
    const NoisyEquations e(std::move(r));
    Chain chain(e.equations, e.answered, e.readings, e.sampler);
    const auto all = test::effect_of("resistance", {{"change_Ohm", kUnknown}}, e.facts);
    chain.set_noise(NoiseFit()(chain, chain.residual({all}), {}));
    const Rows rows(e.sampler, false), held_out(e.sampler, true);
    const Fitter fitter(chain, rows, held_out);
    // Over time no other rows are there that could judge: told beside a claim, a doubt alone.
    const auto claim = test::effect_of("cogging", {{"order", 7}, {"amplitude_Nm", 1e-6}}, e.facts);
    for (const Members& members : {Members{}, Members{claim}}) {
      int over_others = 0;  // in the voltage that the resistance changes
      for (const Structure& s : residual_structure(fitter, fitter.start(members))) {
        if (s.channel != "d") continue;
        over_others += s.regressor != "t";
        EXPECT_EQ(s.doubt.empty(), everywhere || !members.empty()) << s.text;
      }
      EXPECT_EQ(over_others > 0, everywhere) << members.size();
    }
  }
}

// The same in all rows, of an angle whose counts are so wide that half of one has twice that voltage.
TEST(Rest, BelowHalfACountsVoltageIsInDoubt) {
  constexpr double kSwing = 0.1, kUnknown = 9, kOmega_m = 1;  // A, ohm, rad/s
  for (const bool coarse : {false, true}) {
    Record r = noisy_drive(kGain, 0, kSwing);
    for (std::size_t k = 0; k < r.size(); ++k) r.u_alphabeta[k] += kUnknown * r.i_alphabeta[k];
    const double emf = kOmega_m * winding().n_p * winding().psi_f;  // of 1 rad, electrical
    const double half_count = (coarse ? 2.5 : 1) * kUnknown * kSwing / emf;
    NoisyEquations e(std::move(r));
    e.record.angle.lsb = 2 * half_count / winding().n_p;  // of its noise none is drawn
    Chain chain(e.equations, e.answered, e.readings, e.sampler);
    const auto all = test::effect_of("resistance", {{"change_Ohm", kUnknown}}, e.facts);
    chain.set_noise(NoiseFit()(chain, chain.residual({all}), {}));
    const Rows rows(e.sampler, false), held_out(e.sampler, true);
    const Fitter fitter(chain, rows, held_out);
    int of_d = 0;
    for (const Structure& s : residual_structure(fitter, fitter.start({}))) {
      if (s.channel != "d") continue;
      ++of_d;
      EXPECT_EQ(s.doubt.find("half a count") != std::string::npos, coarse) << s.text << s.doubt;
    }
    EXPECT_EQ(of_d, 1);
  }
}

}  // namespace
}  // namespace twinrate
