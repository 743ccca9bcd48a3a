// Slow runs without load: currents of tenths of an ampere, half of them noise and the response of
// the drive to it.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include "tests/plan/servo_log.hpp"
#include "trace/tracer.hpp"

namespace twinrate::slow_run_test {

TraceResult trace_with(const std::string& effects, const std::vector<std::string>& more = {}) {
  std::vector<std::string> settings = {"run.duration_s=10"};
  settings.insert(settings.end(), more.begin(), more.end());
  const PlanLog slow = run(servo(effects, settings));
  Config model = servo("", settings);
  read_all_tables(model);
  return trace_record(slow.record, model.drive(), slow.health, {});
}

// A dead time is named, or nothing is and the verdict says that something is left.
void expect_dead_time_or_doubt(const TraceResult& r) {
  for (const TracedEffect& e : r.effects) EXPECT_EQ(e.effect->kind(), "dead_time") << r.sentence;
  if (r.effects.empty()) {
    EXPECT_EQ(r.verdict, "unexplained") << r.sentence;
    EXPECT_FALSE(r.refused.empty());
  }
}

// A voltage gain is an alias at that speed, but not during the start, which is over in one block;
// and the fitted currents never leave the zone around zero.
TEST(SlowRun, NamesNothingElseForADeadTimeThatItsStartSeparates) {
  expect_dead_time_or_doubt(trace_with("[[effect]]\nkind = \"dead_time\"\ndead_time_s = 1e-6\n"));
}

// With its slope of 30 ohm, the noise of i_d dominates the d residual and depends on i_d.
TEST(SlowRun, NamesNothingElseForADeadTimeThatLooksLikeAResistance) {
  expect_dead_time_or_doubt(trace_with(
      "[[effect]]\nkind = \"dead_time\"\ndead_time_s = 1.46e-6\nlinear_current_A = 0.106\n",
      {"machine.B_Nms=0.01", "reference.speed_rpm=[[0, 0], [0.2, 40], [5, -35]]"}));
}

// The fast noise is a hundred times the voltage of the resistance change; the slow noise is not.
TEST(SlowRun, FindsAWindingThatWarmsUp) {
  constexpr double kChange = 0.25;  // ohm
  const TraceResult r = trace_with(fmt::format(
      "[[effect]]\nkind = \"resistance\"\nchange_Ohm = {}\ntime_constant_s = 5\n", kChange));
  ASSERT_EQ(r.effects.size(), 1u) << r.sentence;
  ASSERT_EQ(r.effects[0].effect->kind(), "resistance") << r.sentence;
  EXPECT_NEAR(r.effects[0].parameters.at(0).value, kChange, 0.15 * kChange);
}

// The declared load moves the rotor; half a row of it acts like a delay of the angle.
TEST(SlowRun, FindsAnInertiaFromTheStepsOfADeclaredLoad) {
  constexpr double kChange = -1.6e-3;  // kgm2
  const TraceResult r =
      trace_with(fmt::format("[[effect]]\nkind = \"inertia\"\nchange_kgm2 = {}\n", kChange),
                 {"load.T_load_Nm=[[0, 0], [3, 2], [4.5, -1], [7, 1.5]]"});
  ASSERT_EQ(r.effects.size(), 1u) << r.sentence;
  ASSERT_EQ(r.effects[0].effect->kind(), "inertia") << r.sentence;
  EXPECT_NEAR(r.effects[0].parameters.at(0).value / kChange, 1, 0.002);
}

TEST(SlowRun, FindsNothingWhereNothingIsMissing) {
  const TraceResult r = trace_with("");
  EXPECT_TRUE(r.effects.empty()) << r.sentence;
  EXPECT_TRUE(r.unexplained.empty()) << r.sentence;
}

}  // namespace twinrate::slow_run_test
