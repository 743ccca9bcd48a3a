// Writes figure.svg: f_bmin and f_bmin/f_e over f_e in the layout of Dilys 2021, Figs 6 and 12,
// with the rule of seven gains a turn, the drive's name and the command. On the paper's motor also
// the points measured in the paper (400 rad/s: 416 Hz held, 384 Hz lost). A
// curve is all limits with one policy, or with one filter and policy.
#pragma once
#include "sweep/result.hpp"

namespace twinrate::sweep {

struct Caption {
  std::string drive, command;
  bool paper_points = false;
};

// The points measured in the paper belong to its motor.
bool is_motor_of_the_paper(const MachineParameters& m);

void write_figure(const std::string& path, const std::vector<Limit>& limits,
                  const Caption& caption);
// One figure of several sweeps of one drive, a curve for each filter and policy. Throws BadInput if
// a directory holds no finished sweep.
void write_figure_of(const std::vector<std::string>& directories, const std::string& path);

}  // namespace twinrate::sweep
