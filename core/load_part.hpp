// Parts of the programs that are loaded at their first use, with libraries that few verbs need:
// matio brings HDF5 and curl, Ceres brings LAPACK, and every other verb starts without them.
//
// The part NAME is the file twinrate-NAME.so in parts_directory() (cmake/part.cmake). It exports one
// symbol, `twinrate_part`: a function, or a table of functions. It stays loaded until the program ends.
#pragma once
#include <string>

// Before the definition of twinrate_part.
#define TWINRATE_PART extern "C" __attribute__((visibility("default")))

namespace twinrate {

// The address of `twinrate_part`. Throws MachineError if the part, or a library of it, is missing.
void* load_part(const std::string& name);

}  // namespace twinrate
