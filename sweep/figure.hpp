// Writes figure.svg: f_bmin and f_bmin/f_e over f_e in the layout of Dilys 2021, Figs 6 and 12,
// with the rule of seven gains a turn and the points measured in the paper (400 rad/s: 416 Hz held,
// 384 Hz lost).
#pragma once
#include "sweep/result.hpp"

namespace twinrate::sweep {

void write_figure(const std::string& path, const std::vector<Limit>& limits);

}  // namespace twinrate::sweep
