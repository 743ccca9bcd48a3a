#include "run/links.hpp"

#include <gtest/gtest.h>

namespace twinrate {
namespace {

constexpr std::int64_t kMs = 1'000'000;

// The answer of a process whose clock is `offset_ns` ahead, after a way there and a way back.
reply_t answer(const request_t& request, std::int64_t there_ns, std::int64_t offset_ns,
               Role role = Role::kEstimator) {
  reply_t reply{};
  reply.seq = request.seq;
  reply.role = static_cast<std::int32_t>(role);
  reply.t_ns = request.seq + there_ns + offset_ns;
  reply.text = "bench-2";
  return reply;
}

TEST(Links, TheOffsetIsThatOfTheShortestRoundTripAndWithinHalfOfIt) {
  Links links({Role::kEstimator});
  const std::int64_t offset_ns = -7'000 * kMs;
  std::int64_t now_ns = 100 * kMs;
  for (const std::int64_t there_ms : {4, 1, 9}) {  // the way back takes 1 ms
    const request_t request = links.ask(now_ns);
    links.take(answer(request, there_ms * kMs, offset_ns), now_ns + (there_ms + 1) * kMs);
    now_ns += 100 * kMs;
  }
  const LinkFigures link = links.figures(now_ns).front();
  EXPECT_EQ(link.offset_ns, offset_ns);  // 1 ms there and 1 ms back
  EXPECT_EQ(link.error_ns, kMs);
  EXPECT_EQ(link.round_trip_us.p50, 5000);
  EXPECT_EQ(link.round_trip_us.max, 10000);
  EXPECT_EQ(link.lost, 0);
  EXPECT_EQ(links.name_of(Role::kEstimator), "estimator on bench-2");
}

TEST(Links, ARequestWithoutAnswerIsLostAfterASecondAndAnAnswerCountsOnce) {
  Links links({Role::kEstimator, Role::kGain});
  const request_t first = links.ask(100 * kMs);
  links.ask(200 * kMs);
  for (int i = 0; i < 3; ++i) links.take(answer(first, kMs, 0), 102 * kMs);
  links.take(answer(first, kMs, 0, Role::kController), 102 * kMs);  // not one of the links
  const auto estimator = [&](std::int64_t now_ns) { return links.figures(now_ns).front(); };
  EXPECT_EQ(estimator(300 * kMs).asked, 2);
  EXPECT_EQ(estimator(300 * kMs).lost, 0) << "the second one is on its way";
  EXPECT_EQ(estimator(1300 * kMs).lost, 1);
  EXPECT_EQ(links.figures(1300 * kMs).back().lost, 2) << "the gain process answered nothing";
  EXPECT_EQ(links.figures(1300 * kMs).back().host, "");
}

TEST(Links, WithoutLinksNothingIsAsked) {
  EXPECT_FALSE(Links({}).due(1'000'000 * kMs));
  EXPECT_TRUE(Links({Role::kGain}).due(1'000'000 * kMs));
}

}  // namespace
}  // namespace twinrate
