// In a slow run friction, fan and constant load are aliases of each other; a trace with the planned
// run finds the true one.
#include "plan/plan.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "model/random.hpp"
#include "plan/outside.hpp"
#include "tests/plan/servo_log.hpp"
#include "trace/measured.hpp"
#include "trace/tracer.hpp"

namespace twinrate {
namespace {

constexpr const char* kFriction = R"(
[[effect]]
kind = "coulomb_friction"
torque_Nm = 0.1
)";

const Config& declared() {
  static const Config config = [] {
    Config c = servo("");
    read_all_tables(c);
    return c;
  }();
  return config;
}

PlanRequest friction_kinds() {
  return {.kinds = {"constant_load", "coulomb_friction", "fan_load", "viscous_friction"},
          .longest_s = 5};
}

TEST(PlanMeasurement, SeparatesTheAliasesOfASlowRun) {
  const PlanLog slow = run(servo(kFriction));
  const TraceResult before = trace_record(slow.record, declared().drive(), slow.health, {});
  ASSERT_EQ(before.verdict, "ambiguous") << before.sentence;
  ASSERT_FALSE(before.ambiguous.empty());
  EXPECT_NE(before.ambiguous[0].would_separate.find("--plan"), std::string::npos);

  const Plan plan = make_plan(declared(), friction_kinds(), {slow}, {});
  ASSERT_EQ(plan.kinds, friction_kinds().kinds);
  EXPECT_TRUE(plan.checked);
  EXPECT_LE(plan.profile.duration_s, 5);
  EXPECT_TRUE(plan.never.empty());
  for (std::size_t a = 0; a < plan.kinds.size(); ++a) {
    EXPECT_FALSE(plan.log[a].separated()) << plan.kinds[a];
    EXPECT_TRUE(plan.after[a].separated()) << plan.kinds[a];
  }

  // The planned drive file with an undeclared friction.
  const TraceResult after = [&] {
    const PlanLog log = run(Config::parse(plan_toml(declared(), plan) + kFriction, "plan.toml"));
    return trace_record(log.record, declared().drive(), log.health, {});
  }();
  EXPECT_EQ(after.verdict, "traced") << after.sentence;
  ASSERT_EQ(after.effects.size(), 1u) << after.sentence;
  EXPECT_EQ(after.effects[0].effect->kind(), "coulomb_friction");
  EXPECT_NEAR(after.effects[0].parameters.at(0).value, 0.1, 2e-3);
}

TEST(PlanMeasurement, ShowsAStepAtAnUnknownMomentAndAGap) {
  const Plan plan = make_plan(
      declared(), {.kinds = {"backlash", "constant_load", "load_step"}, .longest_s = 3}, {}, {});
  ASSERT_EQ(plan.kinds, (std::vector<std::string>{"constant_load", "load_step"}));
  EXPECT_NEAR(plan.after[1].sine[0], std::sqrt(0.5), 1e-3) << "in half of the rows";
  EXPECT_TRUE(plan.after[1].separated());
  ASSERT_EQ(plan.outside.size(), 1u);
  EXPECT_EQ(plan.outside[0].kind, "backlash");
  EXPECT_TRUE(plan.outside[0].in_run);
  ASSERT_FALSE(plan.order.empty());
  EXPECT_EQ(plan.blocks[plan.order[0]].name, "reversals");
  EXPECT_TRUE(nlohmann::json::parse(plan_json(plan)).at("outside_the_design")[0].at("in_run"));

  const auto named = [&](const std::string& effect) {
    const PlanLog log = run(Config::parse(plan_toml(declared(), plan) + effect, "plan.toml"));
    const TraceResult r = trace_record(log.record, declared().drive(), log.health, {});
    return r.effects.size() == 1 ? std::string(r.effects[0].effect->kind()) : r.sentence;
  };
  EXPECT_EQ(named("[[effect]]\nkind = \"load_step\"\ntorque_Nm = 0.05\ntime_s = 0.5\n"),
            "load_step");
  EXPECT_EQ(named("[[effect]]\nkind = \"backlash\"\nJ_load_kgm2 = 2.6e-3\ngap_rad = 0.008\n"
                  "stiffness_Nm_rad = 470\ndamping_Nms_rad = 0.22\n"),
            "backlash");
}

TEST(PlanMeasurement, ReportsTheBusRippleOfTheLog) {
  PlanLog slow = run(servo(""));
  const PlanRequest request{.kinds = {"constant_load", "coulomb_friction", "dc_bus_ripple"},
                            .longest_s = 2};
  const Plan plan = make_plan(declared(), request, {slow}, {});
  ASSERT_EQ(plan.outside.size(), 1u);
  EXPECT_NE(plan.outside[0].log.find("never changes"), std::string::npos);
  for (std::size_t k = 0; k < slow.record.v_dc.size(); ++k)
    slow.record.v_dc[k] += 0.2 * normal(3, 1, k);
  EXPECT_EQ(outside_the_design(plan, {slow}, declared().drive())[0].log, "would show");
  slow.record.v_dc.clear();
  EXPECT_EQ(outside_the_design(plan, {slow}, declared().drive())[0].log, "v_dc is not in the log");
}

TEST(PlanMeasurement, KeepsItsResultsWhenStopped) {
  int calls = 0;
  const PlanHooks hooks{.progress = {}, .stop = [&] { return ++calls > 60; }};
  const Plan plan = make_plan(declared(), friction_kinds(), {}, hooks);
  EXPECT_FALSE(plan.checked);
  ASSERT_FALSE(plan.order.empty());
  EXPECT_LT(*std::max_element(plan.order.begin(), plan.order.end()), plan.blocks.size() / 2);
  EXPECT_EQ(plan.after.size(), 4u);
  EXPECT_TRUE(plan.log.empty());
  const auto json = nlohmann::json::parse(plan_json(plan));
  EXPECT_EQ(json.at("kinds").size(), 4u);
  EXPECT_FALSE(json.at("checked_by_simulation").get<bool>());
}

TEST(PlanMeasurement, BadInputIsOneLine) {
  const auto message = [](PlanRequest request) -> std::string {
    try {
      make_plan(declared(), request, {}, {});
    } catch (const BadInput& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_NE(message({.kinds = {"dead_time", "gravity"}}).find("gravity"), std::string::npos);
  EXPECT_NE(message({.kinds = {"dead_time"}}).find("at least two"), std::string::npos);
  EXPECT_NE(message({.kinds = {"dead_time", "backlash", "dc_bus_ripple"}}).find("at least two"),
            std::string::npos);
  EXPECT_NE(message({.speed_max_rpm = -5}).find("--max-speed"), std::string::npos);
  EXPECT_NE(message({.kinds = {"dead_time", "resistance"}, .longest_s = 0.1}).find("shortest"),
            std::string::npos);
  EXPECT_EQ(message({.kinds = {"dead_time"}}).find('\n'), std::string::npos);
}

}  // namespace
}  // namespace twinrate
