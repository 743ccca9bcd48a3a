// The noise model is that of the sensors, independent of the columns.
#include "trace/noise.hpp"

#include <gtest/gtest.h>

#include "model/random.hpp"
#include "tests/trace/synthetic_drive.hpp"
#include "trace/tracer.hpp"

namespace twinrate {
namespace {

Eigen::VectorXd white(std::uint64_t stream, Eigen::Index n) {
  Eigen::VectorXd x(n);
  for (Eigen::Index k = 0; k < n; ++k) x[k] = normal(7, stream, static_cast<std::uint64_t>(k));
  return x;
}

TEST(Unexplained, KeepsTheResidualThatNoColumnExplains) {
  constexpr Eigen::Index n = 6000;
  const Eigen::VectorXd a = white(1, n), b = white(2, n), noise = white(3, n);
  Unexplained by;
  by.look_at({&a, &b});
  const Eigen::VectorXd y = 40 * a - 3 * b + noise;
  EXPECT_LT((by(y, 2) - noise).norm(), 0.05 * noise.norm());
  EXPECT_NEAR(by(y, 1).norm() / (noise - 3 * b).norm(), 1, 0.02);
}

TEST(Unexplained, KeepsNoProductOfAColumnThatChanged) {
  constexpr Eigen::Index n = 6000;
  const Eigen::VectorXd a = white(1, n), b = white(2, n), d = white(4, n), e = white(5, n);
  const Eigen::VectorXd y = 3 * a + 2 * d + white(3, n);
  Unexplained kept, fresh;
  kept.look_at({&a, &b, &e});
  kept.look_at({&a, &d, &e});
  fresh.look_at({&a, &d, &e});
  EXPECT_LT((kept(y, 3) - fresh(y, 3)).norm(), 1e-9 * y.norm());
}

// A ripple of 0.3 A that the voltages drive passes for noise of the currents, thirty times the sensors'.
TEST(NoiseFloor, IsNoMoreThanTheRecordHolds) {
  Health health;
  const RawLog raw = simulate_synthetic({.duration_s = 3, .dither = 40});
  const TraceResult r =
      trace_record(make_record(raw, servo().machine.n_p, health), servo(), health, {}, {});
  ASSERT_TRUE(r.electrical);
  EXPECT_NEAR(r.electrical->noise_floor / r.electrical->after.held_out, 1, 0.2);
}

// Sixty slow columns with a small fast part, and a noise with almost no slow part: a fit for white
// noise would follow the fast part and leave a slow residual.
TEST(Unexplained, KnowsSlowColumnsBetterThanTheWholeNoiseLetsIt) {
  constexpr Eigen::Index n = 8000, kWaves = 60, kTogether = 50;
  constexpr double kRipple = 0.5;
  const Eigen::VectorXd w = white(3, n + 1), noise = w.tail(n) - w.head(n);
  std::vector<Eigen::VectorXd> waves;
  Unexplained::Columns columns;
  Eigen::VectorXd y = noise;
  for (Eigen::Index j = 0; j < kWaves; ++j)
    waves.push_back(
        kRipple * white(10 + static_cast<std::uint64_t>(j), n).array() +
        (kPi * static_cast<double>(2 * j + 1) * Eigen::ArrayXd::LinSpaced(n, 0, 1)).sin());
  for (const Eigen::VectorXd& wave : waves) {
    columns.push_back(&wave);
    y += 0.3 * wave;
  }
  const auto slow_power = [&](const Eigen::VectorXd& x) {
    double sum = 0;
    for (Eigen::Index first = 0; first < n; first += kTogether)
      sum += std::pow(x.segment(first, kTogether).mean(), 2);
    return sum;
  };
  Unexplained unweighed, weighed;
  const Runs one_run{.row = std::vector<std::size_t>(n), .start = {0}};
  weighed.expect(Whitener(noise, one_run));
  unweighed.look_at(columns);
  weighed.look_at(columns);
  EXPECT_LT(slow_power(weighed(y, kWaves)), 2 * slow_power(noise));
  EXPECT_GT(slow_power(unweighed(y, kWaves)), 5 * slow_power(noise));
}

// Nothing is missing: the residual is noise. In a slow run i_d is pure noise, the controller
// responds to it, and the columns of an asymmetry have i_d in common.
TEST(NoiseFit, IsThatOfTheSensorsInASlowRunToo) {
  for (const bool slow : {false, true}) {
    Health health;
    Record record = make_record(simulate_synthetic({.slow = slow}), 3, health);
    for (std::size_t k = 0; slow && k < record.size(); ++k) {
      constexpr double kController = 20;  // V/A
      const double theta_e = 3 * record.theta_m[k], i_d = park(record.i_alphabeta[k], theta_e)[0];
      record.u_alphabeta[k] += inverse_park({-kController * i_d, 0}, theta_e);
    }
    const DriveFacts facts = servo().facts();
    const Equations equations(record, facts);
    const std::vector<char> moving = moving_rows(equations.record());
    const Sampler sampler(record, moving, held_out_rows(record, 0.25, 3));
    const NoisierRecords noisier = add_noise(record, facts, moving, health.i_lsb);
    const Equations answered(noisier.answered, facts), readings(noisier.readings, facts);
    const Chain chain(equations, answered, readings, sampler);
    const Dictionary dictionary{.sampled = make_candidates(chain), .whitened = {}};
    const Sampled y = chain.residual({});
    const NoiseModel noise = NoiseFit()(chain, y, dictionary);
    const auto rms = [](const Eigen::VectorXd& x) {
      return x.norm() / std::sqrt(static_cast<double>(x.size()));
    };
    EXPECT_NEAR(noise.d.rms() / rms(y.d), 1, 0.15) << (slow ? "slow" : "fast");
    EXPECT_NEAR(noise.q.rms() / rms(y.q), 1, 0.15) << (slow ? "slow" : "fast");
  }
}

// At 1 kHz a vector that turns 130 times a second moves by its own length from row to row; in rotor
// axes it stands still.
TEST(AddNoise, DrawsTheNoiseOfACurrentThatTurnsFast) {
  constexpr double kNoise = 0.02, kTurn = 0.8, kAxis = 1.5;  // A; rad a row; A
  Record record;
  record.T_s = 1e-3;
  record.current_sensors = 3;
  for (std::size_t k = 0; k < 4000; ++k) {
    record.t.push_back(1e-3 * static_cast<double>(k));
    record.theta_m.push_back(kTurn * static_cast<double>(k) / 3);
    record.i_alphabeta.push_back(inverse_park({0, kAxis}, kTurn * static_cast<double>(k)) +
                                 kNoise * Vec2(normal(5, 0, k), normal(5, 1, k)));
  }
  record.u_alphabeta.assign(record.size(), Vec2::Zero());
  record.electrical_ok.assign(record.size(), 1);
  record.motion_ok.assign(record.size(), 1);
  const Record drawn =
      add_noise(record, servo().facts(), std::vector<char>(record.size(), 1), 0).readings;
  double sum = 0;
  for (std::size_t k = 0; k < record.size(); ++k)
    sum += (drawn.i_alphabeta[k] - record.i_alphabeta[k]).squaredNorm() / 2;
  EXPECT_NEAR(std::sqrt(sum / static_cast<double>(record.size())), kNoise, 0.1 * kNoise);
}

}  // namespace
}  // namespace twinrate
