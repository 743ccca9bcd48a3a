// fuzz_seeds DIR: writes the seeds of each reader into DIR/NAME/.
#include <fmt/format.h>

#include <filesystem>
#include <fstream>

#include "tests/fuzz/inputs.hpp"

int main(int argc, char** argv) {
  namespace fs = std::filesystem;
  if (argc != 2) {
    fmt::print(stderr, "usage: fuzz_seeds DIR\n");
    return 2;
  }
  for (const auto& reader : twinrate::fuzz::kReaders) {
    const fs::path folder = fs::path(argv[1]) / reader.name;
    fs::create_directories(folder);
    int count = 0;
    for (const auto& seed : reader.seeds()) {
      std::ofstream out(folder / fmt::format("seed-{:02}", count++), std::ios::binary);
      out.write(reinterpret_cast<const char*>(seed.data()),
                static_cast<std::streamsize>(seed.size()));
    }
  }
}
