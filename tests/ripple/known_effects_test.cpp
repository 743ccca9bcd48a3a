// An effect in the model: the filter corrects it and the controller compensates it.
#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>
#include <regex>
#include <sstream>

#include "core/config.hpp"
#include "tests/ripple/ripple.hpp"

namespace twinrate::test {
namespace {

// niewiara2020 with every effect of its plant also in the model.
std::string all_known() {
  std::ifstream in(preset_directory() + "/niewiara2020.toml");
  std::stringstream text;
  text << in.rdbuf();
  return std::regex_replace(text.str(), std::regex("\\[\\[effect\\]\\]"),
                            "[[effect]]\nused_in = \"both\"");
}

TEST(KnownEffects, OfTheWholeReferenceSetRemoveNearlyAllRipple) {
  const std::string path =
      testing::TempDir() + "twinrate-known-" + std::to_string(getpid()) + ".toml";
  std::ofstream(path) << all_known();
  for (const double speed_rpm : {20.0, 50.0}) {
    const double off = ripple(speed_rpm, 2, 3, {"controller.compensation=off"}).rms;
    const double known = ripple(speed_rpm, 2, 3, {"controller.compensation=paper"}, path).rms;
    EXPECT_LT(known, 0.02 * off) << speed_rpm;
    EXPECT_GT(known, 1e-4) << speed_rpm;  // noise remains
  }
}

// With two current sensors the third phase carries the errors of the other two.
TEST(KnownEffects, OfCurrentSensorsAreUndoneWithTwoSensorsToo) {
  const std::string path =
      testing::TempDir() + "twinrate-known-two-" + std::to_string(getpid()) + ".toml";
  std::ofstream(path) << all_known();
  const std::string two = "sensors.current_sensors=2";
  const double off = ripple(20, 2, 3, {"controller.compensation=off", two}).rms;
  EXPECT_LT(ripple(20, 2, 3, {"controller.compensation=paper", two}, path).rms, 0.01 * off);
}

}  // namespace
}  // namespace twinrate::test
