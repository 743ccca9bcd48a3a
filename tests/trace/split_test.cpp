#include "trace/split.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "model/frames.hpp"

namespace twinrate {
namespace {

constexpr int kPolePairs = 3;
constexpr std::size_t kTicks = 24000;  // 6 s

// `i_dq` of each row; the rotor turns by `omega_m` rad/s of each row.
template <class Current, class Speed>
Record moving(Current&& i_dq, Speed&& omega_m) {
  Record r;
  r.T_s = 2.5e-4;
  double theta_m = 0;
  for (std::size_t k = 0; k < kTicks; ++k) {
    r.t.push_back(r.T_s * static_cast<double>(k));
    r.theta_m.push_back(theta_m);
    r.i_alphabeta.push_back(inverse_park(i_dq(k), kPolePairs * theta_m));
    theta_m += omega_m(k) * r.T_s;
  }
  r.electrical_ok.assign(kTicks, 1);
  r.motion_ok.assign(kTicks, 1);
  return r;
}

double share(const std::vector<char>& rows, std::size_t first, std::size_t end) {
  return static_cast<double>(std::count(rows.begin() + static_cast<std::ptrdiff_t>(first),
                                        rows.begin() + static_cast<std::ptrdiff_t>(end), 1)) /
         static_cast<double>(end - first);
}

TEST(Split, AShortStartIsFittedAndChosenAndJudged) {
  constexpr std::size_t kLasts = kTicks / 24;  // of a start in 6 s: 0.25 s
  for (const std::size_t first : {0UL, 4000UL, 9100UL, 22000UL}) {
    const auto starts = [=](std::size_t k) { return k >= first && k < first + kLasts; };
    double omega_m = 0;
    const Record record =
        moving([&](std::size_t k) { return Vec2(0, starts(k) ? 8 : 0.5); },
               [&](std::size_t k) { return omega_m += starts(k) ? 100.0 / kLasts : 0; });
    const std::vector<char> judges = held_out_rows(record, 0.25, kPolePairs),
                            chooses = choosing_rows(record, judges, kPolePairs);
    const double judged = share(judges, first, first + kLasts),
                 chosen = share(chooses, first, first + kLasts);
    EXPECT_GT(judged, 0.1) << first;
    EXPECT_GT(chosen, 0.1) << first;
    EXPECT_LT(judged + chosen, 0.7) << first;
    EXPECT_NEAR(share(judges, 0, kTicks), 0.25, 0.07) << first;
  }
}

TEST(Split, NoBlockIsShorterThanAQuarterOfAnEvenOne) {
  const Record record = moving([](std::size_t k) { return Vec2(0, k % 8000 == 4000 ? 1e3 : 1); },
                               [](std::size_t) { return 20.0; });
  const std::vector<char> judges = held_out_rows(record, 0.25, kPolePairs);
  std::size_t run = 0, shortest = kTicks;
  for (std::size_t k = 0; k < kTicks; ++k) {
    if (judges[k]) ++run;
    if (run > 0 && (!judges[k] || k + 1 == kTicks)) shortest = std::min(shortest, run), run = 0;
  }
  EXPECT_GE(shortest, kTicks / 24 / 4 - 1);
}

// All of it in one part of 24.
TEST(Split, SomeOfTheCurrentAlongDIsFittedWhereverItFlows) {
  for (std::size_t part = 0; part < 24; ++part) {
    const Record record =
        moving([=](std::size_t k) { return Vec2(24 * k / kTicks == part ? 2 : 0, 1); },
               [](std::size_t k) { return 60 * std::sin(1e-3 * static_cast<double>(k)); });
    const std::vector<char> judges = held_out_rows(record, 0.25, kPolePairs),
                            chooses = choosing_rows(record, judges, kPolePairs);
    const std::size_t first = part * kTicks / 24, end = (part + 1) * kTicks / 24;
    EXPECT_LT(share(judges, first, end) + share(chooses, first, end), 0.7) << part;
  }
}

// As long as a fourth of them sees a fair part of it.
TEST(Split, BlocksOfADriveThatMovesThroughoutAreEven) {
  const Record record =
      moving([](std::size_t k) { return Vec2(0, 2 + std::sin(3e-3 * static_cast<double>(k))); },
             [](std::size_t k) { return 60 * std::sin(2e-3 * static_cast<double>(k)); });
  const std::vector<std::size_t> block = blocks_of_rows(record, kPolePairs);
  for (std::size_t k = 0; k < kTicks; ++k) ASSERT_EQ(block[k], 24 * k / kTicks) << k;
}

}  // namespace
}  // namespace twinrate
