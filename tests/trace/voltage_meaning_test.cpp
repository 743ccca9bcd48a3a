// The voltage of a tick in a decimated log.
#include "trace/voltage_meaning.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/trace/synthetic_drive.hpp"
#include "trace/equations.hpp"
#include "trace/keys.hpp"
#include "trace/tracer.hpp"

namespace twinrate {
namespace {

constexpr int kTicks = 10;     // a row
constexpr double kTurn = 0.8;  // rad, electrical, a row

// A rotor at constant speed, of which every kTicks-th tick is logged.
template <class VoltageOfTick>
Record turning(std::size_t rows, const DriveFacts& facts, const VoltageOfTick& of_tick) {
  Record record;
  record.T_s = kTicks * facts.T_s;
  for (std::size_t k = 0; k < rows; ++k) {
    const auto row = static_cast<double>(k);
    record.t.push_back(record.T_s * row);
    record.theta_m.push_back(kTurn * row / facts.machine.n_p);
    record.u_alphabeta.push_back(of_tick(kTicks * row));
  }
  return record;
}

// At constant speed: against the sum of the steps that a controller makes from row to row.
TEST(VoltageMeaning, TheMeanOfTicksIsThatOfTheStepsBetweenTwoRows) {
  const DriveFacts facts = servo().facts();
  const auto of_tick = [](double ticks) {
    return inverse_park({3, 10}, kTurn / kTicks * (ticks + 0.5));
  };
  const Record record = turning(50, facts, of_tick);
  Vec2 sum = Vec2::Zero();
  for (int tick = 0; tick < kTicks; ++tick) sum += of_tick(20 * kTicks + tick);
  const Vec2 mean = with_mean_of_ticks(record, facts).u_alphabeta[20];
  EXPECT_NEAR((mean - sum / kTicks).norm(), 0, 1e-9);
}

// The mean of a tick's voltages holds the drops of the ticks at the row's ends, and not the mean of the
// drop over the row: the declared dead time takes away what each logged tick's current dropped.
TEST(VoltageMeaning, TheMeanOfTicksHoldsTheDropsAtTheRowsEnds) {
  const DriveFacts facts = servo().facts();
  const auto dead_time = make_effect("dead_time");
  set_key(*dead_time, "dead_time_s", 2e-6);
  set_key(*dead_time, "linear_current_A", 0.1);
  ASSERT_EQ(dead_time->prepare(facts), "");
  const Vec2 i_dq(0, 5);
  // Its mean over a tick: the voltage is held while the magnets turn.
  const MachineParameters& m = facts.machine;
  const double turn = kTurn / kTicks, turned = turn * turn / 12,
               decayed = m.R_s * turn * facts.T_s / 12;
  const Vec2 i_mean = (1 - turned) * i_dq - Vec2(turned * m.psi_f / m.L_d, 0) +
                      decayed * Vec2(-i_dq[1] / m.L_d, i_dq[0] / m.L_q);
  const auto drop_of_tick = [&](double ticks) {
    OperatingPoint p;
    p.v_dc = 235.4;
    p.theta_e = kTurn / kTicks * (ticks + 0.5);
    p.d_axis = {std::cos(p.theta_e), std::sin(p.theta_e)};
    p.i_dq = i_mean;
    return Vec2(p.stator_axes(dead_time->at(p).u_dq_drop));
  };
  const auto record = [&](const auto& of_tick) {
    Record r = turning(200, facts, of_tick);
    for (std::size_t k = 0; k < r.size(); ++k)
      r.i_alphabeta.push_back(inverse_park(i_dq, kTurn * static_cast<double>(k)));
    r.v_dc.assign(r.size(), 235.4);
    r.T_load.assign(r.size(), 0);
    r.electrical_ok.assign(r.size(), 1);
    r.motion_ok.assign(r.size(), 1);
    return with_mean_of_ticks(r, facts);
  };
  const Record with = record(drop_of_tick), without = record([](double) { return Vec2(0, 0); });
  const auto left = [&](const Channels& residual) {
    const Channels plain = Equations(without, facts).residual({});
    double sum = 0;
    for (std::size_t k = 50; k < 150; ++k)
      sum += (Vec2(residual.d[k], residual.q[k]) - Vec2(plain.d[k], plain.q[k])).squaredNorm();
    return std::sqrt(sum / 100);
  };
  const Equations equations(with, facts);
  EXPECT_GT(left(equations.residual({})), 1.0);
  EXPECT_LT(left(equations.residual({dead_time})), 1e-9);
}

// One row for ten ticks, whose voltage shows nothing and is left out.
TEST(VoltageMeaning, TheSentenceSaysThatTheVoltageWasNotUsed) {
  const RawLog ticks = simulate_synthetic({.duration_s = 8});
  RawLog rows;
  rows.path = "slow";
  for (std::size_t k = 0; k < ticks.size(); k += 10) {
    rows.t.push_back(ticks.t[k]);
    for (const RawColumn& c : raw_columns())
      if (!(ticks.*c.values).empty()) (rows.*c.values).push_back((ticks.*c.values)[k]);
  }
  const auto sentence = [](const RawLog& raw) {
    Health health;
    const Record record = make_record(raw, servo().machine.n_p, health);
    return trace_record(record, servo(), health, {}).sentence;
  };
  const std::string unused = " The voltage was not used: no electrical effect is traced.";
  EXPECT_TRUE(sentence(rows).ends_with(unused)) << sentence(rows);
  EXPECT_EQ(sentence(ticks).find(unused), std::string::npos);
}

}  // namespace
}  // namespace twinrate
