#include "core/paths.hpp"

#include <filesystem>

namespace twinrate {

namespace fs = std::filesystem;

std::string executable_directory() {
  std::error_code error;
  const fs::path self = fs::read_symlink("/proc/self/exe", error);
  return error ? "." : self.parent_path().string();
}

std::string data_directory() {
  const fs::path installed = fs::path(executable_directory()).parent_path() / "share" / "twinrate";
  return fs::is_directory(installed) ? installed.string() : TWINRATE_SOURCE_DIR;
}

}  // namespace twinrate
