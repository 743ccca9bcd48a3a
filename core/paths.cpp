#include "core/paths.hpp"

#include <dlfcn.h>
#include <unistd.h>

#include <filesystem>

namespace twinrate {

namespace fs = std::filesystem;

namespace {

// The directory of the programs for a module of Python: bin/ of an installed tree, or tools/ of a
// build tree, above it.
std::string programs_above(fs::path module) {
  while (module.has_relative_path()) {
    module = module.parent_path();
    for (const char* folder : {"bin", "tools"})
      if (access((module / folder / "twinrate").c_str(), X_OK) == 0)
        return (module / folder).string();
  }
  return ".";
}

}  // namespace

std::string executable_directory() {
  std::error_code error;
  Dl_info own{};
  if (dladdr(reinterpret_cast<const void*>(&executable_directory), &own) != 0 && own.dli_fname &&
      fs::path(own.dli_fname).extension() == ".so")
    return programs_above(fs::absolute(own.dli_fname, error));
  const fs::path self = fs::read_symlink("/proc/self/exe", error);
  return error ? "." : self.parent_path().string();
}

std::string data_directory() {
  const fs::path installed = fs::path(executable_directory()).parent_path() / "share" / "twinrate";
  return fs::is_directory(installed) ? installed.string() : TWINRATE_SOURCE_DIR;
}

}  // namespace twinrate
