// Every kept input of the fuzzers, every seed, and seeds cut short or with a bit turned: no reader of
// foreign input ends the program, hangs or believes what does not hold.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <random>

#include "tests/fuzz/inputs.hpp"

namespace twinrate::fuzz {
namespace {

namespace fs = std::filesystem;

class Corpus : public testing::TestWithParam<Reader> {};

TEST_P(Corpus, IsReadWithoutHarm) {
  const Reader& reader = GetParam();
  int files = 0;
  for (const auto& entry : fs::directory_iterator(fs::path(TWINRATE_CORPUS) / reader.name)) {
    std::ifstream in(entry.path(), std::ios::binary);
    const std::string text{std::istreambuf_iterator<char>(in), {}};
    reader.read(reinterpret_cast<const std::uint8_t*>(text.data()), text.size());
    ++files;
  }
  EXPECT_GT(files, 10);
}

TEST_P(Corpus, MutatedSeedsAreReadWithoutHarm) {
  const Reader& reader = GetParam();
  const std::vector<Bytes> seeds = reader.seeds();
  ASSERT_FALSE(seeds.empty());
  std::mt19937 draw(1);
  for (int trial = 0; trial < 400; ++trial) {
    Bytes bytes = seeds[draw() % seeds.size()];
    for (unsigned turned = draw() % 4; turned > 0; --turned)
      bytes[draw() % bytes.size()] ^= static_cast<std::uint8_t>(1u << draw() % 8);
    if (trial % 3 == 0) bytes.resize(draw() % bytes.size());
    reader.read(bytes.data(), bytes.size());
  }
}

INSTANTIATE_TEST_SUITE_P(Fuzz, Corpus, testing::ValuesIn(kReaders),
                         [](const auto& reader) { return std::string(reader.param.name); });

}  // namespace
}  // namespace twinrate::fuzz
