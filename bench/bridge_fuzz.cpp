// libFuzzer on one decoder of the bridge; tools of the normal build do not need clang. By hand:
//
//   bench/fuzz_bridge [SECONDS]      builds each with clang and ASan into build-fuzz/ and runs it
#include "tests/bridge/fuzz.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  return twinrate::fuzz::TWINRATE_FUZZ(bytes, size);
}
