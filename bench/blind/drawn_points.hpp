// Static sets and bus voltages of machines drawn at random: with nothing missing and sensors that
// are noisy, loud, coarse or drift, with something that no kind describes, and with one effect of
// known size.
#pragma once
#include <string>
#include <vector>

#include "bench/blind/drawn_machine.hpp"
#include "trace/result.hpp"

namespace twinrate::blind {

enum class PointSet { kFluxMap, kInverterCurve, kHoldingCurrent, kBusVoltage };
inline constexpr const char* kPointSets[] = {"flux map", "inverter curve", "holding current",
                                             "bus voltage"};
// How the readings differ from the declared model. kSmall: constants off by less than matters.
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
