// The command that this process was started with, for the manifest of a run.
#pragma once
#include <string>

namespace twinrate {

// "twinrate simulate dilys2021 --set rates.n=13": the program without its folder, each word quoted
// for a shell where it has to be.
std::string command_text(int argc, const char* const* argv);

void remember_command(std::string text);
// Empty if no command was remembered.
const std::string& remembered_command();

}  // namespace twinrate
