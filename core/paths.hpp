// The program's own files: beside itself when installed, in the source tree otherwise. In the
// Python module "itself" is the module, whose programs are in bin/ above it.
#pragma once
#include <string>

namespace twinrate {

std::string executable_directory();
// Holds config/ and report/: PREFIX/share/twinrate, or the source tree of the build.
std::string data_directory();
// Holds the parts that are loaded at their first use: PREFIX/lib/twinrate/parts, or parts/ of the
// build.
std::string parts_directory();
std::string revision();  // git revision that was built

}  // namespace twinrate
