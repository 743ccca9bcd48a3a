// The blocks of a long log represent its whole; its health is that of every row.
#include "trace/blocks.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "model/random.hpp"
#include "tests/trace/synthetic_drive.hpp"
#include "trace/health_scan.hpp"
#include "trace/record.hpp"

namespace twinrate {
namespace {

constexpr double kStep_s = 1e-4;
constexpr std::size_t kRecordRows = 256, kSlots = 6000, kBlocks = 24, kLength = 48;

// A drive at one speed, with three short changes of the operating point.
std::vector<Slot> dull_log() {
  std::vector<Slot> slots(kSlots);
  for (std::size_t k = 0; k < kSlots; ++k) {
    Slot& s = slots[k];
    s.rows = kRecordRows;
    s.t_begin = static_cast<double>(k * kRecordRows) * kStep_s;
    s.t_end = s.t_begin + static_cast<double>(kRecordRows - 1) * kStep_s;
    s.omega_m = 50 + 0.5 * normal(3, 0, k);
    s.i_q = 1 + 0.1 * normal(3, 1, k);
    s.i_d = 0.02 * normal(3, 2, k);
    if (k >= 1000 && k < 1010) s.omega_m = -60;
    if (k >= 3101 && k < 3105) s.i_q = 9;
    if (k >= 5900 && k < 5920) s.i_d = -3;
  }
  return slots;
}

template <class Value>
std::pair<double, double> range(const std::vector<Slot>& slots, const std::vector<Block>& blocks,
                                Value&& value) {
  double lowest = 1e300, highest = -1e300;
  for (const Block& b : blocks)
    for (std::size_t k = b.first; k < b.end; ++k) {
      lowest = std::min(lowest, value(slots[k]));
      highest = std::max(highest, value(slots[k]));
    }
  return {lowest, highest};
}

TEST(Blocks, HoldTheRareStatesOfTheLogAndAllOfItsTime) {
  const std::vector<Slot> slots = dull_log();
  const std::vector<Block> blocks = choose_blocks(slots, kBlocks, kLength, kStep_s);
  ASSERT_EQ(blocks.size(), kBlocks);
  for (std::size_t b = 0; b < kBlocks; ++b) {
    EXPECT_EQ(blocks[b].end - blocks[b].first, kLength);
    // One in each equal part of the log: none overlaps the next.
    EXPECT_GE(blocks[b].first, kSlots * b / kBlocks);
    EXPECT_LE(blocks[b].end, kSlots * (b + 1) / kBlocks);
  }
  EXPECT_EQ(range(slots, blocks, [](const Slot& s) { return s.omega_m; }).first, -60);
  EXPECT_EQ(range(slots, blocks, [](const Slot& s) { return s.i_q; }).second, 9);
  EXPECT_EQ(range(slots, blocks, [](const Slot& s) { return s.i_d; }).first, -3);
  // Blocks at fixed places would not contain them.
  std::vector<Block> fixed;
  for (std::size_t b = 0; b < kBlocks; ++b)
    fixed.push_back({kSlots * b / kBlocks, kSlots * b / kBlocks + kLength});
  EXPECT_LT(range(slots, fixed, [](const Slot& s) { return s.i_q; }).second, 2);
}

TEST(Blocks, NoneHoldsAGap) {
  std::vector<Slot> slots = dull_log();
  for (std::size_t k = 3000; k < kSlots; ++k) {  // a pause of 100 s
    slots[k].t_begin += 100;
    slots[k].t_end += 100;
  }
  for (const Block& b : choose_blocks(slots, 3, kLength, kStep_s))
    EXPECT_FALSE(b.first < 3000 && b.end > 3000) << b.first;
}

TEST(Blocks, SlotsHoldTheMeansOfTheirRowsWhateverTheirAxes) {
  RawLog raw;
  constexpr double kSpeed = 80;
  for (int k = 0; k < 256; ++k) {
    const double theta_m = std::fmod(6.2 + kSpeed * k * kStep_s, kTwoPi);  // begins again
    const Vec3 i = inverse_clarke(inverse_park({-1.5, 4}, 3 * theta_m));
    raw.t.push_back(k * kStep_s);
    raw.theta_m.push_back(theta_m);
    raw.i_a.push_back(i[0]);
    raw.i_b.push_back(i[1]);
  }
  const Slot slot = slot_of(raw, 3);
  EXPECT_NEAR(slot.omega_m, kSpeed, 1e-9);
  EXPECT_NEAR(slot.i_d, -1.5, 1e-12);
  EXPECT_NEAR(slot.i_q, 4, 1e-12);
  EXPECT_EQ(slot.rows, 256u);
}

RawLog rows_of(const RawLog& raw, std::size_t first, std::size_t end) {
  const auto part = [&](const std::vector<double>& x) {
    return x.empty() ? x
                     : std::vector<double>(x.begin() + static_cast<std::ptrdiff_t>(first),
                                           x.begin() + static_cast<std::ptrdiff_t>(end));
  };
  RawLog piece;
  piece.t = part(raw.t);
  for (const RawColumn& c : raw_columns()) piece.*c.values = part(raw.*c.values);
  return piece;
}

// With lost, repeated and clipped rows.
RawLog spoilt_log() {
  const RawLog whole = simulate_synthetic({});
  RawLog raw;
  for (std::size_t k = 0; k + 1 < whole.size(); ++k) {
    if (k % 83 == 7) continue;
    RawLog row = rows_of(whole, k, k + 1);
    for (auto* i : {&row.i_a, &row.i_b, &row.i_c}) i->front() = std::clamp(i->front(), -1.5, 1.5);
    raw.append(row);
    if (k % 50 == 0) {
      row = rows_of(whole, k + 1, k + 2);
      row.i_a = {raw.i_a.back()}, row.i_b = {raw.i_b.back()}, row.i_c = {raw.i_c.back()};
      row.v_dc = {raw.v_dc.back()}, row.theta_m = {raw.theta_m.back()};
      raw.append(row);
      ++k;
    }
  }
  return raw;
}

TEST(HealthScan, PiecesAddUpToTheWhole) {
  const RawLog raw = spoilt_log();
  HealthScan at_once, by_pieces;
  at_once.add(raw);
  for (std::size_t first = 0; first < raw.size(); first += 100)
    by_pieces.add(rows_of(raw, first, std::min(first + 100, raw.size())));
  const Health a = at_once.health(), b = by_pieces.health();
  EXPECT_EQ(a.rows, b.rows);
  EXPECT_DOUBLE_EQ(a.T_s, b.T_s);
  EXPECT_NEAR(a.T_s, kStep_s, 1e-9);
  EXPECT_EQ(a.missing_share, b.missing_share);
  EXPECT_NEAR(a.missing_share, 1.0 / 83, 1e-3);
  EXPECT_EQ(a.stale_share, b.stale_share);
  EXPECT_NEAR(a.stale_share, 1.0 / 50, 2e-3);
  EXPECT_EQ(a.i_lsb, b.i_lsb);
  EXPECT_NEAR(a.i_lsb, 0.009765625, 1e-9);
  EXPECT_EQ(a.i_limit, b.i_limit);
  EXPECT_EQ(a.i_limit, 1.5);
  EXPECT_EQ(a.clipped_share, b.clipped_share);
  EXPECT_GT(a.clipped_share, 0.01);
  EXPECT_NEAR(a.jitter, b.jitter, 1e-3);
}

TEST(HealthScan, ALongPauseTakesNoMoreRowsThanItsEdges) {
  RawLog raw = simulate_synthetic({});
  const std::size_t half = raw.size() / 2;
  for (std::size_t k = half; k < raw.size(); ++k) raw.t[k] += 3600;
  Health health;
  const Record record = make_record(raw, 3, health);
  EXPECT_LT(record.size(), raw.size() + 20000);
  EXPECT_EQ(record.t.back(), raw.t.back());
  for (std::size_t k = half; k < half + 9000; ++k) ASSERT_FALSE(record.motion_ok[k]);
}

}  // namespace
}  // namespace twinrate
