#include "core/config_difference.hpp"

#include <gtest/gtest.h>

#include "core/command_line.hpp"
#include "core/config.hpp"

namespace twinrate {
namespace {

TEST(ConfigDifference, NamesTheKeysOfWhichTwoFilesDiffer) {
  const std::string first = "name = \"a\"\n[rates]\nn = 5\nf_s_Hz = 5000.0\n",
                    second =
                        "name = \"a\"\n[rates]\nf_s_Hz = 5000.0\nn = 13\n"
                        "[[effect]]\nkind = \"cogging\"\norders = [6, 12]\n";
  const auto keys = differing_keys({first, second, first});
  ASSERT_EQ(keys.size(), 3u);
  EXPECT_EQ(keys[0].path, "effect[0].kind");
  EXPECT_EQ(keys[1].path, "effect[0].orders");
  EXPECT_EQ(keys[2].path, "rates.n");
  EXPECT_EQ(keys[2].values, (std::vector<std::string>{"5", "13", "5"}));
  EXPECT_EQ(keys[0].values[0], "");
  EXPECT_TRUE(differing_keys({second, second}).empty());
  EXPECT_TRUE(differing_keys({}).empty());
  EXPECT_THROW(differing_keys({"[rates"}), BadInput);
}

TEST(CommandText, CanBeGivenToAShell) {
  const char* argv[] = {"/usr/bin/twinrate", "simulate", "my drive.toml", "--set",
                        "name=o'neil",       ""};
  EXPECT_EQ(command_text(6, argv),
            R"(twinrate simulate 'my drive.toml' --set 'name=o'\''neil' '')");
}

}  // namespace
}  // namespace twinrate
