// The man page of a program or verb, from its options as --help shows them.
#pragma once
#include <string>

namespace CLI {
class App;
}

namespace twinrate {

// Troff of section 1. `name`: of the page, twinrate-launch.
std::string man_page(const CLI::App& app, const std::string& name);

}  // namespace twinrate
