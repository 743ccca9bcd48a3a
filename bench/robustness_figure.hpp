// Angle error of each filter over errors of R_s, L_q and psi_f, as SVG text: three filters in the
// upper row, the filter as printed in the lower row with its own scale.
#pragma once
#include <array>
#include <string>
#include <vector>

namespace twinrate {

struct RobustnessCurve {
  std::string estimator;
  int column = 0;  // of the figure: R_s, L_q, psi_f
  std::vector<double> x_pct,
      e_deg;  // mean angle error over the filter's parameter less the plant's; NaN: lost
};

inline constexpr std::array<double, 3> kParameterSpan_pct = {50, 20, 10};

std::string robustness_svg(const std::vector<RobustnessCurve>& curves);

}  // namespace twinrate
