// load_drive() reads the tables of every owner and refuses unknown kinds and tables.
#include "loop/load_drive.hpp"

#include <gtest/gtest.h>

#include "core/field_list.hpp"
#include "estimator/make_filter.hpp"

namespace twinrate {
namespace {

std::string refusal(const std::vector<std::string>& overrides) {
  try {
    load_drive("dilys2021", overrides);
  } catch (const BadInput& error) {
    return error.what();
  }
  return "";
}

TEST(LoadDrive, ResolvedTextLoadsAgainToTheSameText) {
  for (const std::string& preset : preset_names()) {
    Config config = load_drive(preset);
    make_filter(config);  // reads its table a second time
    Config again = Config::parse(config.resolved(), "resolved.toml");
    read_all_tables(again);
    EXPECT_EQ(again.resolved(), load_drive(preset).resolved()) << preset;
  }
}

TEST(LoadDrive, ReadsTablesOfKindsThatAreNotChosen) {
  const Config config = load_drive("dilys2021", {"estimator.ekf_disturbance.L_Nm_rad=-3"});
  EXPECT_NE(config.resolved().find("[estimator.ekf_disturbance]"), std::string::npos);
  EXPECT_EQ(load_drive("dilys2021").resolved().find("ekf_disturbance"), std::string::npos);
  EXPECT_NE(refusal({"estimator.ekf_disturbance.M=1"}).find("unknown key"), std::string::npos);
}

TEST(LoadDrive, UnknownKindsAndTablesAreRefused) {
  EXPECT_NE(refusal({"estimator.kind=magic"}).find("estimator.kind: one of ekf_sensorless"),
            std::string::npos);
  EXPECT_NE(refusal({"controller.kind=magic"}).find("controller.kind: one of foc"),
            std::string::npos);
  EXPECT_NE(refusal({"estimator.magic.Q=1"}).find("estimator.magic: unknown table"),
            std::string::npos);
}

TEST(FieldList, SplitsUnitsOffKeys) {
  const std::pair<const char*, NameAndUnit> cases[] = {
      {"amplitude_Nm", {"amplitude", "Nm"}}, {"smooth_rad_s", {"smooth", "rad_s"}},
      {"phase_rad", {"phase", "rad"}},       {"slew_Nm_s", {"slew", "Nm_s"}},
      {"order", {"order", "per_rev"}},       {"seed", {"seed", "1"}}};
  for (const auto& [key, expected] : cases) {
    EXPECT_EQ(split_unit(key).name, expected.name);
    EXPECT_EQ(split_unit(key).unit, expected.unit);
  }
}

}  // namespace
}  // namespace twinrate
