// One input of a fuzzer through a decoder; 0 as libFuzzer wants it. bench/bridge_fuzz.cpp links each
// with libFuzzer, tests/bridge/fuzz_test.cpp runs mutated whole frames through them.
#pragma once
#include <cstddef>
#include <cstdint>

namespace twinrate::fuzz {

int twinrate_frames(const std::uint8_t* bytes, std::size_t size);
int moteus_lines(const std::uint8_t* bytes, std::size_t size);
int moteus_registers(const std::uint8_t* bytes, std::size_t size);
int moteus_burst(const std::uint8_t* bytes, std::size_t size);
int vesc_frames(const std::uint8_t* bytes, std::size_t size);

}  // namespace twinrate::fuzz
