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

namespace {

// "" for a program of a build tree.
std::string installed_directory(const char* folder) {
  const fs::path prefix = fs::path(executable_directory()).parent_path();
  return fs::is_directory(prefix / "share" / "twinrate") ? (prefix / folder / "twinrate").string()
                                                         : "";
}

}  // namespace

std::string data_directory() {
  const std::string installed = installed_directory("share");
  return installed.empty() ? TWINRATE_SOURCE_DIR : installed;
}

std::string parts_directory() {
  const std::string installed = installed_directory(TWINRATE_LIBRARIES);
  return (installed.empty() ? TWINRATE_BUILD_DIR : installed) + "/parts";
}

}  // namespace twinrate
