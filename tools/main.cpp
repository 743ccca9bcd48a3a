// twinrate: runs a verb, prints an error in one line.
#include <fmt/format.h>

#include <cstdio>

#include "core/config.hpp"
#include "core/machine_error.hpp"
#include "tools/run_verb.hpp"

namespace {

int failed(const std::exception& error, int code) {
  fmt::print(stderr, "twinrate: {}\n", error.what());
  return code;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return twinrate::run_verb(argc, argv);
  } catch (const twinrate::BadInput& error) {
    return failed(error, 2);
  } catch (const twinrate::MachineError& error) {
    return failed(error, 3);
  } catch (const std::exception& error) {
    return failed(error, 1);
  }
}
