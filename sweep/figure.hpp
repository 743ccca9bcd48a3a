// figure.svg: f_bmin against f_e, and f_bmin/f_e against f_e, in the layout of Dilys 2021, Figs 6
// and 12, with the rule of seven gains a turn and the measured points of the paper's text (400
// rad/s: 416 Hz held, 384 Hz lost).
#pragma once
#include "sweep/result.hpp"

namespace twinrate::sweep {

void write_figure(const std::string& path, const std::vector<Limit>& limits);

}  // namespace twinrate::sweep
