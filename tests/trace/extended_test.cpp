#include "trace/extended.hpp"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "core/config.hpp"
#include "tests/support/effects.hpp"

namespace twinrate {
namespace {

TracedEffect traced_effect(const char* kind, std::map<std::string, double> values) {
  TracedEffect e;
  e.effect = test::effect_of(kind, std::move(values));
  return e;
}

// Of one that begins or ends, the files of its part; of one in the samples, no claim.
TEST(TraceJson, AnEffectListsTheFilesThatItWasFittedToOrJudgedOn) {
  TraceResult result;
  result.sources = {"a.csv", "b.csv"};
  result.held_out_sources = {"b.csv", "c.csv"};
  const std::map<std::string, double> torque{{"torque_Nm", 0.1}};
  for (int i = 0; i < 3; ++i) result.effects.push_back(traced_effect("coulomb_friction", torque));
  result.effects[1].only_in_part = true;
  result.effects[1].files = {"b.csv"};
  result.effects[2].from_samples = true;
  const auto effects = nlohmann::json::parse(to_json(result))["effects"];
  EXPECT_EQ(effects[0]["files"], (std::vector<std::string>{"a.csv", "b.csv", "c.csv"}));
  EXPECT_EQ(effects[1]["files"], std::vector<std::string>{"b.csv"});
  EXPECT_TRUE(effects[2]["files"].empty());
}

// A filter of what is logged is no property of the drive: nothing is to compensate it.
TEST(ExtendedToml, AnErrorOfTheLogAloneIsLeftOutAndNamed) {
  const Config drive = Config::load("niewiara2020", {"effect=[]"});
  TraceResult result;
  result.sentence = "two effects";
  result.sources = {"a directory\n[machine]/log.csv"};
  result.effects.push_back(
      traced_effect("cogging", {{"order", 12}, {"amplitude_Nm", 0.15}, {"phase_rad", 0.4}}));
  result.effects.push_back(traced_effect("viscous_friction", {{"coefficient_Nms", 2e-3}}));
  result.effects.back().only_in_log = true;
  const std::string text = extended_toml(drive, result, false);
  EXPECT_NE(text.find("# left out: viscous_friction, an error of the log, not of the drive"),
            std::string::npos)
      << text;
  const auto effects = Config::parse(text, "extended").drive().effects;
  ASSERT_EQ(effects.size(), 1u) << text;
  EXPECT_EQ(effects[0].effect->kind(), "cogging");
  EXPECT_EQ(effects[0].used_in, UsedIn::kBoth);
}

}  // namespace
}  // namespace twinrate
