// A temporary directory, removed with its contents.
#pragma once
#include <stdlib.h>

#include <filesystem>
#include <string>

#include "core/machine_error.hpp"

namespace twinrate {

class Scratch {
 public:
  Scratch() : path_((std::filesystem::temp_directory_path() / "twinrate-cortex-XXXXXX").string()) {
    if (!mkdtemp(path_.data())) throw MachineError(path_ + ": cannot be made");
  }
  ~Scratch() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

}  // namespace twinrate
