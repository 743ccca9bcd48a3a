// Slips of a drive file: values that a data sheet gives in another unit or convention. Each is a
// guess from two values that belong together.
//
//   T_rated    against the largest torque at i_rated      off by sqrt(3), sqrt(2), 2, 1.5 ..; the
//              losses of a motor make its rated torque smaller, never larger
//   psi_f      against rated speed and v_dc               the EMF alone exceeds the voltage of v_dc
//   J          against T_rated and rated speed            a run-up of minutes: g cm2, kg cm2
//   bandwidths against the rates                          the loops have no phase margin left
#pragma once
#include <optional>
#include <string>
#include <vector>

#include "core/drive_config.hpp"

namespace twinrate {

struct Slip {
  std::string key;   // of the drive file
  std::string what;  // one line
};

// Range of the ratio of two related values without a slip.
struct RatioBand {
  double least = 0.97, most = 1.03;  // half the way from sqrt(2) to 1.5
};

// "off by a factor 1.73: sqrt(3), line to line or phase?": the factors that bring the ratio into
// the band, the nearest first; without a name if no factor does.
std::string factor_text(double ratio, const RatioBand& without_slip = {});

// Nm, at the best current angle and the peak current `i`.
double largest_torque(const MachineParameters& m, double i);

// `current_Hz`, `speed_Hz`: bandwidths of the controller, if it has them.
std::vector<Slip> slips_of(const DriveConfig& drive, std::optional<double> current_Hz,
                           std::optional<double> speed_Hz);

}  // namespace twinrate
