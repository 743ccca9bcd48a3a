// Static sets and bus voltages of machines drawn at random. In some nothing is missing, and the
// sensors have little or much noise, coarse steps or drift. Others have a deviation that no kind
// describes, or one effect of known size.
#pragma once
#include <string>
#include <vector>

#include "bench/blind/drawn_machine.hpp"
#include "trace/result.hpp"

namespace twinrate::blind {

enum class PointSet { kFluxMap, kInverterCurve, kHoldingCurrent, kBusVoltage };
inline constexpr const char* kPointSets[] = {"flux map", "inverter curve", "holding current",
                                             "bus voltage"};
// Difference of the readings from the declared model. kSmall: the constants differ by less than the
// smallest size worth reporting.
enum class Spoilt { kPlain, kSmall, kLoud, kCoarse, kDrifting, kUnknown, kEffect };
inline constexpr const char* kSpoilt[] = {"plain",    "small",   "loud",  "coarse",
                                          "drifting", "unknown", "effect"};

struct PointCase {
  PointSet set;
  Spoilt spoilt;
  std::vector<std::string> truth,
      aliases;  // kinds; aliases: kinds that cannot be separated from them
  TraceResult result;
};

PointCase trace_points(PointSet set, Spoilt spoilt, std::uint64_t seed);

}  // namespace twinrate::blind
