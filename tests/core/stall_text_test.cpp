// The count of stalls in the text of an event.
#include "core/stall_text.hpp"

#include <gtest/gtest.h>

namespace twinrate {
namespace {

TEST(StallText, IsReadBack) {
  const std::string text = "tick began 310 us late: why (2 more since the last report)" +
                           stall_text({.stalls = 12, .stood_s = 0.04321, .longest_s = 0.0128});
  const auto count = stall_count_in(text);
  ASSERT_TRUE(count);
  EXPECT_EQ(count->stalls, 12);
  EXPECT_EQ(count->stood_s, 0.04321);
  EXPECT_EQ(count->longest_s, 0.0128);
  EXPECT_FALSE(stall_count_in("tick began 310 us late: why (2 more since the last report)"));
  EXPECT_FALSE(stall_count_in(text + " and more"));
  EXPECT_FALSE(stall_count_in(""));
}

}  // namespace
}  // namespace twinrate
