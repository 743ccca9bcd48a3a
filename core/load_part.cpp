#include "core/load_part.hpp"

#include <dlfcn.h>
#include <fmt/format.h>

#include "core/machine_error.hpp"
#include "core/paths.hpp"

namespace twinrate {

void* load_part(const std::string& name) {
  const std::string path = fmt::format("{}/twinrate-{}.so", parts_directory(), name);
  void* const part = dlopen(path.c_str(), RTLD_LAZY | RTLD_LOCAL);
  void* const symbol = part ? dlsym(part, "twinrate_part") : nullptr;
  if (!symbol)
    throw MachineError(fmt::format(
        "a part of twinrate cannot be loaded: {}; install twinrate again, with the libraries it "
        "needs, or build it: tools/build-all",
        dlerror()));
  return symbol;
}

}  // namespace twinrate
