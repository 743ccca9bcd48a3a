// The process of a controller around any control law.
//
//   MEASUREMENT(k), ESTIMATE(k), REFERENCE(k) -> [Controller::step] -> COMMAND(k)
//
// twinrate-controller runs it with the controller of the drive file. A program of your own runs it
// with its own:
//
//   int main(int argc, char** argv) {
//     return twinrate::run_controller("my_law", argc, argv, twinrate::own_controller<MyLaw>);
//   }
#pragma once
#include <functional>

#include "controller/guarded.hpp"
#include "controller/make_controller.hpp"

namespace twinrate {

using MakeController = std::function<std::unique_ptr<Controller>(Config&, Begin)>;

// Reads the options of every process (--help lists them) and runs until the end of the drive.
// `program`: its name in messages. Returns the exit code.
int run_controller(const char* program, int argc, char** argv, const MakeController& make);

// For run_controller(): creates a Law from the drive file, behind the guard of guarded.hpp.
template <class Law>
std::unique_ptr<Controller> own_controller(Config& config, Begin) {
  return std::make_unique<Guarded>(std::make_unique<Law>(config));
}

}  // namespace twinrate
