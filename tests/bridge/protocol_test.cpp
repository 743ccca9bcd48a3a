// firmware/protocol: framing, CRC, sequence, time and lease.
#include <gtest/gtest.h>
#include <zlib.h>

#include <cstring>
#include <random>

#include "firmware/protocol/twinrate_protocol.h"
#include "tests/bridge/protocol_c.h"

namespace twinrate::protocol_test {
namespace {

using Bytes = std::vector<std::uint8_t>;

Bytes written(const twp_frame& f) {
  Bytes wire(TWP_MAX_WIRE);
  wire.resize(twp_write(&f, wire.data()));
  return wire;
}

// The results of every byte that ends something, and the last whole frame.
std::vector<twp_result> received(const Bytes& bytes, twp_frame& f) {
  twp_receiver r{};
  std::vector<twp_result> results;
  for (const std::uint8_t byte : bytes)
    if (const twp_result result = twp_receive(&r, byte, &f); result != TWP_NOTHING)
      results.push_back(result);
  return results;
}

twp_frame full_sample(std::uint16_t flags) {
  twp_frame f{};
  f.header = {.type = TWP_SAMPLE, .flags = flags, .seq = 0xfffffffe, .time_us = 4000000000u};
  f.body.sample = {.command_seq = 7,
                   .signals = 31,
                   .reason = 72,
                   .state = TWP_SAFE,
                   .mode = 3,
                   .bad_frames = 9,
                   .i_abc = {1.25, -2.5, 0.1},
                   .u_alphabeta = {0, -1e-300},
                   .duty_abc = {0.5, 0, 1},
                   .v_dc = 24.3,
                   .theta_m = -3.7,
                   .omega_m = 1e9 / 3,
                   .theta_forced = 0.7};
  return f;
}

TEST(Protocol, CrcIsThatOfZlib) {
  std::mt19937 random(3);
  for (std::size_t size = 0; size < 300; ++size) {
    Bytes bytes(size);
    for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random());
    EXPECT_EQ(twp_crc32(bytes.data(), size), crc32(0, bytes.data(), static_cast<uInt>(size)));
  }
  const z_crc_t* table = get_crc_table();
  for (int i = 0; i < 16; ++i) EXPECT_EQ(twp_crc_table[i], table[16 * i]) << i;
}

TEST(Protocol, CobsHasNoZeroAndComesBack) {
  std::mt19937 random(5);
  for (std::size_t size = 1; size < 600; ++size) {
    Bytes in(size), out(size + 3 + size / 254), back(size + 3 + size / 254);
    for (std::uint8_t& byte : in)
      byte = static_cast<std::uint8_t>(size % 3 == 0 ? 1 + random() % 255 : random() % 3);
    const std::size_t n = twp_cobs_encode(in.data(), size, out.data());
    EXPECT_LE(n, size + 1 + size / 254);
    for (std::size_t i = 0; i < n; ++i) EXPECT_NE(out[i], 0);
    ASSERT_EQ(twp_cobs_decode(out.data(), n, back.data()), size);
    EXPECT_EQ(std::memcmp(back.data(), in.data(), size), 0) << size;
  }
}

TEST(Protocol, Float64KeepsEveryBit) {
  const twp_frame f = full_sample(TWP_FLOAT64 | TWP_ALL_GROUPS);
  twp_frame g{};
  const Bytes wire = written(f);
  EXPECT_EQ(wire.size(), 126u);
  ASSERT_EQ(received(wire, g), std::vector{TWP_FRAME});
  EXPECT_EQ(g.header.seq, f.header.seq);
  EXPECT_EQ(g.header.time_us, f.header.time_us);
  EXPECT_EQ(g.header.version, TWP_VERSION);
  EXPECT_EQ(g.body.sample.reason, 72);
  EXPECT_EQ(g.body.sample.u_alphabeta[1], -1e-300);
  EXPECT_EQ(g.body.sample.omega_m, 1e9 / 3);
  EXPECT_EQ(g.body.sample.theta_forced, 0.7);
}

TEST(Protocol, Float32RoundsAndGroupsCanBeLeftOut) {
  twp_frame g{};
  ASSERT_EQ(received(written(full_sample(TWP_ALL_GROUPS)), g), std::vector{TWP_FRAME});
  EXPECT_EQ(g.body.sample.i_abc[2], static_cast<double>(0.1f));
  EXPECT_EQ(written(full_sample(TWP_ALL_GROUPS)).size(), 78u);
  g = {};
  const Bytes wire = written(full_sample(TWP_CURRENTS | TWP_VOLTAGE | TWP_BUS));
  EXPECT_EQ(wire.size(), 54u);
  ASSERT_EQ(received(wire, g), std::vector{TWP_FRAME});
  EXPECT_EQ(g.body.sample.v_dc, static_cast<double>(24.3f));
  EXPECT_EQ(g.body.sample.theta_m, 0);
}

TEST(Protocol, OtherFramesComeBack) {
  twp_frame f{}, g{};
  f.header = {.type = TWP_COMMAND, .flags = TWP_FLOAT64, .seq = 3, .time_us = 5};
  f.body.command = {.sample_seq = 11,
                    .lease_us = 20000,
                    .enable = 1,
                    .mode = 1,
                    .kind = TWP_COMMAND_DUTIES,
                    .duty_abc = {0.1, 0.2, 0.3},
                    .theta_ctrl = 0.5};
  ASSERT_EQ(received(written(f), g), std::vector{TWP_FRAME});
  EXPECT_EQ(g.body.command.lease_us, 20000u);
  EXPECT_EQ(g.body.command.duty_abc[2], 0.3);
  EXPECT_EQ(g.body.command.theta_ctrl, 0.5);
  f.body.command.kind = 2;  // unknown
  EXPECT_EQ(received(written(f), g), std::vector<twp_result>{}) << "before the first zero";
  f = {};
  f.header.type = TWP_INFO;
  f.body.info = {.f_s_Hz = 5000, .lease_max_us = 20000, .abilities = 31, .name = "dilys2021"};
  ASSERT_EQ(received(written(f), g), std::vector{TWP_FRAME});
  EXPECT_STREQ(g.body.info.name, "dilys2021");
  EXPECT_EQ(g.body.info.f_s_Hz, 5000);
  f = {};
  f.header.type = TWP_CLEAR;
  f.body.clear.reason = 72;
  ASSERT_EQ(received(written(f), g), std::vector{TWP_FRAME});
  EXPECT_EQ(g.body.clear.reason, 72);
}

// One wrong bit in a frame between two others: it is refused, and nothing else.
TEST(Protocol, EverySingleBitErrorIsFoundAndCostsOneFrame) {
  const Bytes good = written(full_sample(TWP_ALL_GROUPS));
  for (std::size_t bit = 0; bit < 8 * (good.size() - 1); ++bit) {
    Bytes bytes = good, bad = good;
    bad[bit / 8] = static_cast<std::uint8_t>(bad[bit / 8] ^ (1u << bit % 8));
    bytes.insert(bytes.end(), bad.begin(), bad.end());
    bytes.insert(bytes.end(), good.begin(), good.end());
    twp_frame g{};
    const auto results = received(bytes, g);
    EXPECT_EQ(std::count(results.begin(), results.end(), TWP_FRAME), 2) << bit;
    EXPECT_GT(results.size(), 2u) << bit;
  }
}

TEST(Protocol, RandomBytesAreNoFrameAndEndInTime) {
  std::mt19937 random(7);
  twp_receiver r{};
  twp_frame f{};
  for (int i = 0; i < 300000; ++i)
    EXPECT_NE(twp_receive(&r, static_cast<std::uint8_t>(random() % 100), &f), TWP_FRAME);
}

TEST(Protocol, FreestandingCAndCppUnderstandEachOther) {
  Bytes wire(TWP_MAX_WIRE);
  wire.resize(device_sample(41, 8200, -1.5f, wire.data()));
  twp_frame f{};
  ASSERT_EQ(received(wire, f), std::vector{TWP_FRAME});
  EXPECT_EQ(f.header.seq, 41u);
  EXPECT_EQ(f.body.sample.i_abc[0], -1.5);
  EXPECT_EQ(f.body.sample.v_dc, 24);
  f = {};
  f.header.type = TWP_COMMAND;
  f.body.command.u_alphabeta[0] = 3.25;
  const Bytes command = written(f);
  EXPECT_EQ(device_u_alpha(command.data(), command.size()), 3.25f);
}

TEST(Protocol, SequenceAndTimeWrap) {
  EXPECT_EQ(twp_difference(5, 3), 2);
  EXPECT_EQ(twp_difference(3, 5), -2);
  EXPECT_EQ(twp_difference(1, 0xffffffff), 2);
  EXPECT_EQ(twp_difference(0xffffffff, 1), -2);
  EXPECT_EQ(twp_difference(0x80000000u, 0), INT32_MIN);
}

TEST(Protocol, TheLeaseEndsOnceAndAcrossTheWrap) {
  twp_lease lease{};
  EXPECT_FALSE(twp_lease_ended(&lease, 5)) << "never held";
  const std::uint32_t now = 0xffffff00u;
  twp_lease_take(&lease, now, 50000, 20000);  // the device's limit is the shorter one
  EXPECT_FALSE(twp_lease_ended(&lease, now + 19999));
  EXPECT_TRUE(twp_lease_ended(&lease, now + 20000));
  EXPECT_FALSE(twp_lease_ended(&lease, now + 20001)) << "once";
}

}  // namespace
}  // namespace twinrate::protocol_test
