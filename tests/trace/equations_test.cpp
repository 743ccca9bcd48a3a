// Columns against differences of the residual, and sparse sampling against full sampling.
#include "trace/equations.hpp"

#include <gtest/gtest.h>

#include <tuple>

#include "tests/trace/synthetic_drive.hpp"
#include "trace/dictionary.hpp"
#include "trace/keys.hpp"
#include "trace/sampler.hpp"
#include "trace/static_sets.hpp"
#include "trace/thinning.hpp"

namespace twinrate {
namespace {

const Record& record() {
  static const Record kRecord = [] {
    Health health;
    return make_record(simulate_synthetic({.duration_s = 2}), 3, health);
  }();
  return kRecord;
}

// Over several channels: relative difference between (before - after) and the columns.
double disagreement(const std::vector<const std::vector<double>*>& before,
                    const std::vector<const std::vector<double>*>& after,
                    const std::vector<const std::vector<double>*>& column, double coefficient) {
  double size = 0, wrong = 0;
  for (std::size_t c = 0; c < before.size(); ++c)
    for (std::size_t k = 20; k + 20 < before[c]->size(); ++k) {
      const double said = column[c]->empty() ? 0 : coefficient * (*column[c])[k];
      size += said * said;
      wrong += std::pow((*before[c])[k] - (*after[c])[k] - said, 2);
    }
  return std::sqrt(wrong / std::max(size, 1e-30));
}

TEST(Equations, AColumnIsWhatItsEffectTakesOffTheResidual) {
  const DriveFacts facts = servo().facts();
  const Equations equations(record(), facts);
  const Channels before = equations.residual({});
  int compared = 0;
  for (const std::string& kind : effect_kinds()) {
    const auto effect = make_effect(kind);
    effect->prepare(facts);
    const auto count = static_cast<std::size_t>(effect->tracing().regressor_count());
    for (std::size_t r = 0; r < count; ++r) {
      std::vector<double> c(count, 0.0);
      c[r] = 1e-6;
      const auto one = effect->clone();
      one->tracing().set_coefficients(c);
      const std::vector<Channels> columns = equations.columns(*one);
      const Channels after = equations.residual({one});
      // The torque of a flux uses the measured current there, the smoothed one here.
      const Channels& x = columns[r];
      EXPECT_LT(disagreement({&before.torque}, {&after.torque}, {&x.torque}, c[r]), 0.02)
          << kind << " " << r;
      EXPECT_LT(disagreement({&before.d, &before.q}, {&after.d, &after.q}, {&x.d, &x.q}, c[r]),
                0.02)
          << kind << " " << r;
      ++compared;
    }
  }
  EXPECT_GT(compared, 30);
}

TEST(Equations, IronLossLeavesTheVoltageOfAMotorAtSpeedAlone) {
  // Behind R_s: a part of the terminal current makes no torque and causes no voltage drop.
  const DriveFacts facts = servo().facts();
  const Equations equations(record(), facts);
  const auto loss = make_effect("iron_loss");
  set_key(*loss, "resistance_Ohm", 300);
  loss->prepare(facts);
  const Channels before = equations.residual({}), after = equations.residual({loss});
  const double K_t = 1.5 * facts.machine.n_p * facts.machine.psi_f;
  for (std::size_t k = 2000; k < 18000; k += 777) {
    const OperatingPoint& p = equations.points()[k];
    const double omega_e = facts.machine.n_p * p.omega_m;
    const double i_fe_q = omega_e * (facts.machine.psi_f + facts.machine.L_d * p.i_dq[0]) / 300;
    EXPECT_NEAR(before.torque[k] - after.torque[k], K_t * i_fe_q,
                2e-3 + 0.01 * std::abs(K_t * i_fe_q));
  }
}

// One tick at constant speed under a voltage that stands in stator axes, by fine integration in rotor axes.
struct Tick {
  const MachineParameters& m;
  double T, omega_e;

  struct End {
    Vec2 i_dq;
    double torque;  // mean
  };
  End operator()(Vec2 i, const Vec2& u_alphabeta, double psi_f) const {
    constexpr int kParts = 400;
    const auto rate = [&](const Vec2& x, double t) -> Vec2 {
      const Vec2 u = park(u_alphabeta, omega_e * t);
      return {(u[0] - m.R_s * x[0] + omega_e * m.L_q * x[1]) / m.L_d,
              (u[1] - m.R_s * x[1] - omega_e * (m.L_d * x[0] + psi_f)) / m.L_q};
    };
    double torque = 0;
    const double h = T / kParts;
    for (int k = 0; k < kParts; ++k) {
      const double t = h * k;
      const Vec2 k1 = rate(i, t), half = i + h / 2 * k1, k2 = rate(half, t + h / 2),
                 middle = i + h / 2 * k2, k3 = rate(middle, t + h / 2),
                 k4 = rate(i + h * k3, t + h);
      torque += m.torque(middle[0], middle[1]) / kParts;
      i += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
    }
    return {i, torque};
  }
  // The torque of the tick that ends with the current of its beginning.
  double steady_torque(const Vec2& i_dq) const {
    const Vec2 rest = Vec2::Zero(), missing = i_dq - (*this)(i_dq, rest, m.psi_f).i_dq;
    Eigen::Matrix2d of_voltage;
    of_voltage << (*this)(rest, {1, 0}, 0).i_dq, (*this)(rest, {0, 1}, 0).i_dq;
    return (*this)(i_dq, of_voltage.inverse() * missing, m.psi_f).torque;
  }
};

TEST(Equations, ATorqueIsTheMeanOfATickAndNotOfItsSamples) {
  constexpr std::size_t kCount = 400;
  constexpr double kTurn = 0.3;  // rad, electrical, a tick
  struct Case {
    double saliency, R_s;
    Vec2 i_dq;
  };
  // The last one in field weakening: the current along d decays, and turns.
  for (const auto& [saliency, R_s, i_dq] :
       {Case{1, 1.05, {-0.5, 4}}, Case{2.4, 1.05, {-0.5, 4}}, Case{1.2, 10, {-4, 1}}}) {
    DriveFacts facts = servo().facts();
    facts.machine.B = 0;
    facts.machine.R_s = R_s;
    facts.machine.L_q = saliency * facts.machine.L_d;
    const MachineParameters& m = facts.machine;
    const double torque = Tick{m, facts.T_s, kTurn / facts.T_s}.steady_torque(i_dq);
    Record r;
    r.T_s = facts.T_s;
    for (std::size_t k = 0; k < kCount; ++k) {
      const double theta_e = kTurn * static_cast<double>(k);
      r.t.push_back(r.T_s * static_cast<double>(k));
      r.theta_m.push_back(theta_e / m.n_p);
      r.T_load.push_back(torque);
      r.i_alphabeta.push_back(inverse_park(i_dq, theta_e));
    }
    r.motion_ok.assign(kCount, 1);
    r.electrical_ok.assign(kCount, 1);
    const double of_samples = m.torque(i_dq[0], i_dq[1]);
    EXPECT_GT(std::abs(torque / of_samples - 1), 1e-3) << saliency;
    EXPECT_NEAR(Equations(r, facts).residual({}).torque[kCount / 2], 0, 2e-4 * of_samples)
        << saliency;
  }
}

// Without i_d in the log an angle or a lag shows by a reluctance torque alone, and so does a flux that depends on the
// current.
TEST(Equations, KindsThatNeedAMissingCurrentAreNotPossible) {
  Record alone = record();
  alone.i_q_alone = true;
  DriveFacts salient = servo().facts();
  salient.machine.L_q = 2 * salient.machine.L_d;
  const auto possible = [](const Record& log, const DriveFacts& facts, const char* kind) {
    const auto effect = make_effect(kind);
    if (has_key(*effect, "lag_s")) set_key(*effect, "lag_s", 1e-4);
    effect->prepare(facts);
    return Equations(log, facts).possible(*effect);
  };
  for (const char* kind : {"encoder_offset", "signal_lag"}) {
    EXPECT_FALSE(possible(alone, salient, kind)) << kind;
    EXPECT_TRUE(possible(alone, servo().facts(), kind)) << kind;
    EXPECT_TRUE(possible(record(), salient, kind)) << kind;
  }
  EXPECT_FALSE(possible(alone, servo().facts(), "cross_saturation"));
  EXPECT_TRUE(possible(record(), servo().facts(), "cross_saturation"));
  EXPECT_TRUE(possible(alone, servo().facts(), "flux_linkage"));
}

// A rotor without current under a load that steps at a row: its parabolas are exact.
TEST(Equations, ADeclaredLoadActsFromItsRowOn) {
  constexpr double kJump = 2;  // Nm
  constexpr std::size_t kCount = 400, kAt = 200;
  DriveFacts facts = servo().facts();
  facts.machine.B = 0;
  Record r;
  r.T_s = facts.T_s;
  double theta_m = 0, omega_m = 12;
  for (std::size_t k = 0; k < kCount; ++k) {
    const double T_load = k < kAt ? -1 : -1 + kJump, acceleration = -T_load / facts.machine.J;
    r.t.push_back(r.T_s * static_cast<double>(k));
    r.theta_m.push_back(theta_m);
    r.T_load.push_back(T_load);
    r.i_alphabeta.push_back(Vec2::Zero());
    theta_m += r.T_s * (omega_m + 0.5 * r.T_s * acceleration);
    omega_m += r.T_s * acceleration;
  }
  r.motion_ok.assign(kCount, 1);
  r.electrical_ok.assign(kCount, 1);
  const auto left = [&](const Record& record) {
    const std::vector<double> torque = Equations(record, facts).residual({}).torque;
    const auto margin = static_cast<std::ptrdiff_t>(20);
    return std::vector<double>(torque.begin() + margin, torque.end() - margin);
  };
  for (double e : left(r)) ASSERT_NEAR(e, 0, 1e-4);
  double impulse = 0;  // of all rows, of what half a row of the jump is
  for (double e : left(thinned(r, 2, facts.machine.n_p))) impulse += e;
  EXPECT_NEAR(impulse / (0.5 * kJump), 0, 0.01);
  r.load_measured = true;  // the load then rises from the row before
  double largest = 0;
  for (double e : left(r)) largest = std::max(largest, std::abs(e));
  EXPECT_NEAR(largest, 0.5 * kJump * (1 - 1.0 / 6), 0.1);
}

// At constant speed a periodic effect has a closed-form mean: a voltage over an interval, a torque
// over the triangle of a second difference.
TEST(Equations, AnEffectOfTheAngleIsAveragedOverItsInterval) {
  const DriveFacts facts = servo().facts();
  constexpr double kOmega = 12;
  Record r = record();
  for (std::size_t k = 0; k < r.size(); ++k) {
    r.theta_m[k] = kOmega * r.t[k];
    r.i_alphabeta[k] = Vec2::Zero();
  }
  const Equations equations(r, facts);
  const double T_s = r.T_s;
  const auto peak = [&](const std::vector<double>& x) {
    double most = 0;
    for (std::size_t k = 50; k + 50 < x.size(); ++k) most = std::max(most, std::abs(x[k]));
    return most;
  };
  const int N = 36 * 3;
  const double x = N * kOmega * T_s;  // 0.13 rad a row
  const auto ripple = make_effect("flux_harmonics"), cogging = make_effect("cogging");
  for (const auto& effect : {ripple, cogging}) {
    set_key(*effect, "order", N);
    ASSERT_EQ(effect->prepare(facts), "");
  }
  // Flux A cos(N theta): a drop A N omega_m along d, its mean 2 A sin(x/2)/T_s.
  const Channels drop = equations.columns(*ripple)[0];
  EXPECT_NEAR(peak(drop.d) / (2 * std::sin(x / 2) / T_s), 1, 1e-4);
  const std::vector<double> torque_column = equations.columns(*cogging)[0].torque;
  EXPECT_NEAR(peak(torque_column), std::pow(2 * std::sin(x / 2) / x, 2), 1e-4);
  const std::vector<double> every_second = equations.load_columns(*cogging, 3, 2)[0];
  for (std::size_t n = 50; n + 50 < every_second.size(); ++n)
    ASSERT_NEAR(every_second[n], torque_column[3 + 2 * n], 1e-4);
  const auto at = [&](const std::shared_ptr<Effect>& effect, const char* size) {
    const auto one = effect->clone();
    set_key(*one, size, 1e-3);
    return equations.residual({one});
  };
  const Channels before = equations.residual({}), with_cogging = at(cogging, "amplitude_Nm"),
                 with_ripple = at(ripple, "amplitude_Wb");
  std::vector<double> torque, d;
  for (std::size_t k = 0; k < r.size(); ++k) {
    torque.push_back((before.torque[k] - with_cogging.torque[k]) / 1e-3);
    d.push_back((before.d[k] - with_ripple.d[k]) / 1e-3);
  }
  EXPECT_NEAR(peak(torque), std::pow(2 * std::sin(x / 2) / x, 2), 1e-4);
  EXPECT_NEAR(peak(d) / (2 * std::sin(x / 2) / T_s), 1, 1e-4);
}

// A current of one frequency after a filter and after a delay, in closed form.
TEST(Equations, ALateCurrentIsAdvanced) {
  const DriveFacts facts = servo().facts();
  constexpr double kOmega = kTwoPi * 37, kLag = 230e-6;
  const auto turning = [&](double gain, double late) {
    Record r = record();
    for (std::size_t k = 0; k < r.size(); ++k) {
      const double angle = kOmega * r.t[k] - late;
      r.i_alphabeta[k] = 3 * gain * Vec2(std::cos(angle), std::sin(angle));
    }
    return r;
  };
  const Record truth = turning(1, 0);
  const Channels wanted = Equations(truth, facts).residual({});
  for (const auto& [form, gain, late] :
       {std::tuple{0, 1.0, kOmega * kLag},
        std::tuple{1, 1 / std::hypot(1, kOmega * kLag), std::atan(kOmega * kLag)}}) {
    const Record reading = turning(gain, late);
    const Equations equations(reading, facts);
    const auto lag = make_effect("signal_lag");
    set_key(*lag, "signal", 1);
    set_key(*lag, "form", form);
    set_key(*lag, "lag_s", kLag);
    ASSERT_EQ(lag->prepare(facts), "");
    const Channels before = equations.residual({}), after = equations.residual({lag});
    double off = 0, left = 0;
    for (std::size_t k = 50; k + 50 < truth.size(); ++k) {
      off += std::pow(before.d[k] - wanted.d[k], 2) + std::pow(before.q[k] - wanted.q[k], 2);
      left += std::pow(after.d[k] - wanted.d[k], 2) + std::pow(after.q[k] - wanted.q[k], 2);
    }
    EXPECT_LT(std::sqrt(left / off), 0.01) << form;
  }
}

// The reference is v; the acting voltage is (1 + g) v, delayed. A record with the acting voltage
// has the same residual.
TEST(Equations, AGainActsOnTheVoltageThatCameLate) {
  const DriveFacts facts = servo().facts();
  constexpr double kGain_V = 0.06, kSteps = 1.3;
  Record acted = record();
  for (std::size_t k = 2; k < acted.size(); ++k) {
    const std::vector<Vec2>& v = record().u_alphabeta;
    acted.u_alphabeta[k] = (1 + kGain_V) * ((2 - kSteps) * v[k - 1] + (kSteps - 1) * v[k - 2]);
  }
  const auto gain = make_effect("voltage_gain"), lag = make_effect("signal_lag");
  set_key(*gain, "gain", kGain_V);
  set_key(*lag, "signal", 0);
  set_key(*lag, "lag_s", kSteps * record().T_s);
  const Equations asked(record(), facts), truly(acted, facts);
  const Channels wanted = truly.residual({}), before = asked.residual({});
  for (const Effects& both : {Effects{gain, lag}, Effects{lag, gain}}) {
    const Channels left = asked.residual(both);
    double off = 0, wrong = 0;
    for (std::size_t k = 3; k + 3 < record().size(); ++k) {
      off =
          std::max({off, std::abs(before.d[k] - wanted.d[k]), std::abs(before.q[k] - wanted.q[k])});
      wrong =
          std::max({wrong, std::abs(left.d[k] - wanted.d[k]), std::abs(left.q[k] - wanted.q[k])});
    }
    EXPECT_LT(wrong, 1e-9);
    EXPECT_GT(off, 1);
  }
  // Applied separately they would differ from the product (1 + g)(1 - lag).
  const std::vector<char> all(record().size(), 1), none(record().size(), 0);
  const Sampler sampler(record(), all, none);
  const Chain chain(asked, asked, asked, sampler), chain_truly(truly, truly, truly, sampler);
  const Sampled left = chain.residual({gain, lag}), sampled = chain_truly.residual({});
  EXPECT_LT((left.q - sampled.q).norm(), 1e-9 * sampled.q.norm());
}

TEST(Equations, AStiffShaftIsARigidOne) {
  // The load mass follows the motor: its shaft carries J_load omega_m', which the motor no longer
  // has to.
  const DriveFacts facts = servo().facts();
  const Equations equations(record(), facts);
  const std::vector<char> all(record().size(), 1), none(record().size(), 0);
  const Sampler sampler(record(), all, none);
  const auto shaft = make_effect("torsion"), inertia = make_effect("inertia");
  set_key(*shaft, "J_load_kgm2", 3e-3);
  set_key(*shaft, "stiffness_Nm_rad", 3e4);
  set_key(*shaft, "damping_Nms_rad", 10);
  set_key(*inertia, "change_kgm2", 3e-3);
  const auto torque = [&](const Effect& effect) {
    return sampler(equations.contribution(effect).torque, sampler.torque()).norm();
  };
  EXPECT_LT(torque(*shaft), 0.15 * torque(*inertia));
}

TEST(Sampler, SeesTheSameInEverySecondRow) {
  std::vector<char> all(record().size(), 1), none(record().size(), 0);
  const Sampler sampler(record(), all, none);
  ASSERT_EQ(sampler.stride(), 2u);
  for (double f_Hz : {0.0, 40.0, 300.0, 800.0}) {
    std::vector<double> full, sparse;
    for (std::size_t k = 0; k < record().size(); ++k)
      full.push_back(std::cos(kTwoPi * f_Hz * static_cast<double>(k) * record().T_s + 0.3));
    for (std::size_t k = sampler.first(); k < full.size(); k += sampler.stride())
      sparse.push_back(full[k]);
    const Eigen::VectorXd a = sampler(full, sampler.torque()),
                          b = sampler.sparsely(sparse, sampler.torque());
    ASSERT_EQ(a.size(), b.size());
    EXPECT_LT((a - b).cwiseAbs().maxCoeff(), 4e-3) << f_Hz;
  }
}

// Around each multiple of the output rate, which folds onto the slow torques: an angle's counts make
// (f / 25 Hz)^2 times as much torque there.
TEST(Sampler, KeepsWhatIsFastFromTheSlowTorques) {
  const std::vector<char> all(record().size(), 1), none(record().size(), 0);
  const Sampler sampler(record(), all, none);
  const double out_Hz = 1 / (sampler.decimation() * record().T_s);
  for (const int multiple : {1, 2, 3, 4})
    for (const double beside_Hz : {-25., 25.}) {
      const double f_Hz = multiple * out_Hz + beside_Hz;
      if (f_Hz > 0.5 / record().T_s) continue;
      std::vector<double> fast;
      for (std::size_t k = 0; k < record().size(); ++k)
        fast.push_back(std::cos(kTwoPi * f_Hz * static_cast<double>(k) * record().T_s));
      EXPECT_LT(sampler(fast, sampler.torque()).cwiseAbs().maxCoeff(), 3e-5) << f_Hz;
    }
}

// A window that touched both kinds would mix what trains with what is held out.
TEST(Sampler, NoOutputMixesTrainingWithHeldOutRows) {
  std::vector<char> all(record().size(), 1), held(record().size(), 0);
  std::vector<double> kind;
  for (std::size_t k = 0; k < held.size(); ++k) {
    held[k] = k / 3000 % 3 == 1;
    kind.push_back(held[k]);
  }
  const Sampler sampler(record(), all, held);
  const Runs& runs = sampler.torque();
  const Eigen::VectorXd y = sampler(kind, runs);
  ASSERT_GT(y.size(), 1000);
  for (Eigen::Index n = 0; n < y.size(); ++n)
    ASSERT_NEAR(y[n], runs.held_out[static_cast<std::size_t>(n)], 1e-12) << n;
}

// Sums of kept columns in the chain against the equations.
TEST(Chain, ColumnsKeptForOneSizeAreNotUsedForAnother) {
  const DriveFacts facts = servo().facts();
  const Equations equations(record(), facts);
  const std::vector<char> all(record().size(), 1), none(record().size(), 0);
  const Sampler sampler(record(), all, none);
  const Chain chain(equations, equations, equations, sampler);
  const Sampled before = chain.noiseless({});
  int compared = 0;
  for (const std::string& kind : effect_kinds()) {
    const auto effect = make_effect(kind);
    effect->prepare(facts);
    const auto count = static_cast<std::size_t>(effect->tracing().regressor_count());
    if (count == 0 || kind == "iron_loss") continue;  // its columns are those of the whole residual
    const std::vector<double> one(count, 1e-3);
    effect->tracing().set_coefficients(one);
    const double sizes = effect->tracing().materiality(facts);
    for (double size : {2.0, 20.0, 5.0}) {
      std::vector<double> c = one;
      for (double& x : c) x *= size / std::max(1e-9, sizes);
      effect->tracing().set_coefficients(c);
      ASSERT_EQ(effect->prepare(facts), "") << kind;
      const Sampled kept = chain.residual({effect}), whole = chain.noiseless({effect});
      double wrong = 0, change = 0;
      for (const auto channel : {&Sampled::d, &Sampled::q, &Sampled::torque}) {
        wrong += (kept.*channel - whole.*channel).squaredNorm();
        change += (before.*channel - whole.*channel).squaredNorm();
      }
      EXPECT_LT(std::sqrt(wrong / std::max(change, 1e-30)), 0.03) << kind << " of size " << size;
      ++compared;
    }
  }
  EXPECT_GT(compared, 60);
}

}  // namespace
}  // namespace twinrate
