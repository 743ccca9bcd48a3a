// The entry of libFuzzer; TWINRATE_READER names the function of tests/fuzz/inputs.hpp.
#include "tests/fuzz/inputs.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  twinrate::fuzz::TWINRATE_READER(bytes, size);
  return 0;
}
