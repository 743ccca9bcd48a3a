// twinrate-controller: the control law of the drive file.
#include "controller/controller_process.hpp"

int main(int argc, char** argv) {
  return twinrate::run_controller("twinrate-controller", argc, argv, twinrate::make_controller);
}
