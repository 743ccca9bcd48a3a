// The angle error of each filter against errors of R_s, L_q and psi_f, as an SVG text: three
// filters above, the printed one below on its own scale.
#pragma once
#include <array>
#include <string>
#include <vector>

namespace twinrate {

struct RobustnessCurve {
  std::string estimator;
  int column = 0;  // of the figure: R_s, L_q, psi_f
  std::vector<double> x_pct,
      e_deg;  // the filter's parameter less the plant's; mean angle error, NaN: lost
};

inline constexpr std::array<double, 3> kParameterSpan_pct = {50, 20, 10};

std::string robustness_svg(const std::vector<RobustnessCurve>& curves);

}  // namespace twinrate
