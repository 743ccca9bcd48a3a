// Mutated whole frames through each decoder: a second of what bench/bridge_fuzz does for minutes.
#include "tests/bridge/fuzz.hpp"

#include <gtest/gtest.h>

#include <random>

#include "bridge/moteus_codec.hpp"
#include "bridge/vesc_host.hpp"
#include "firmware/protocol/twinrate_protocol.h"

namespace twinrate::fuzz_test {
namespace {

using Decoder = int (*)(const std::uint8_t*, std::size_t);

Bytes twinrate_seed() {
  Bytes all;
  for (const int type : {TWP_SAMPLE, TWP_COMMAND, TWP_INFO, TWP_CLEAR, TWP_HELLO}) {
    twp_frame f{};
    f.header.type = static_cast<std::uint8_t>(type);
    f.header.flags = TWP_ALL_GROUPS;
    std::uint8_t wire[TWP_MAX_WIRE];
    all.insert(all.end(), wire, wire + twp_write(&f, wire));
  }
  return all;
}

Bytes moteus_seed() {
  Bytes frame;
  put_moteus_reply(frame, kMoteusMode, std::vector<float>(6, 1.5f));
  put_moteus_reply(frame, kMoteusMillisecond, std::vector<float>{40});
  const std::string text = "OK\n" + can_line("rcv", 0x100, frame) + " E B\n";
  return {text.begin(), text.end()};
}

Bytes vesc_seed() {
  Bytes all = vesc_frame(Bytes(40, 4)), sample(39, 1);
  sample[0] = VescHost::kSamplePrint;
  const Bytes second = vesc_frame(sample);
  all.insert(all.end(), second.begin(), second.end());
  return all;
}

void mutate(Bytes& bytes, std::mt19937& random) {
  const auto at = [&] {
    return bytes.begin() + static_cast<std::ptrdiff_t>(random() % bytes.size());
  };
  for (int i = 0; i < 3 && !bytes.empty(); ++i) {
    const auto byte = static_cast<std::uint8_t>(random());
    switch (random() % 4) {
      case 0:
        *at() = byte;
        break;
      case 1:
        bytes.erase(at());
        break;
      case 2:
        bytes.insert(at(), byte);
        break;
      default:
        bytes.insert(bytes.end(), bytes.begin(), at());
    }
  }
}

void run(Decoder decoder, const Bytes& seed) {
  std::mt19937 random(11);
  EXPECT_EQ(decoder(seed.data(), seed.size()), 0);
  EXPECT_EQ(decoder(seed.data(), 0), 0);
  for (int i = 0; i < 3000; ++i) {
    Bytes bytes = seed;
    mutate(bytes, random);
    ASSERT_EQ(decoder(bytes.data(), bytes.size()), 0);
  }
}

TEST(Fuzz, TwinrateFrames) {
  run(fuzz::twinrate_frames, twinrate_seed());
}
TEST(Fuzz, MoteusLinesRegistersAndBurst) {
  run(fuzz::moteus_lines, moteus_seed());
  run(fuzz::moteus_registers, Bytes{0x2c, 6, 0, 1, 2, 3, 4, 0x50, 0x21, 0, 10});
  run(fuzz::moteus_burst, Bytes{0x5a, 1, 2, 3, 4, 5, 6, 0x5a, 1, 2, 3, 4, 5, 6, 0x5a});
}
TEST(Fuzz, VescFrames) {
  run(fuzz::vesc_frames, vesc_seed());
}

}  // namespace
}  // namespace twinrate::fuzz_test
