#include "trace/extended.hpp"

#include <fmt/format.h>

#include "core/report_error.hpp"

namespace twinrate {

std::string extended_toml(const Config& config, const TraceResult& result, bool keep_plant) {
  std::vector<ConfiguredEffect> effects;
  std::size_t left_out = 0;
  for (const ConfiguredEffect& e : config.drive().effects) {
    if (e.used_in == UsedIn::kPlant && !keep_plant) {
      ++left_out;
      continue;
    }
    effects.push_back(e);
  }
  const UsedIn used_in = keep_plant ? UsedIn::kModel : UsedIn::kBoth;
  const bool judged = !result.interrupted;
  for (const TracedEffect& e : result.effects)
    if (judged && !e.only_in_log && !e.only_in_part) effects.push_back({e.effect, used_in});
  for (const TracedEffect& e : result.stop_gaps)
    if (judged && !e.only_in_part) effects.push_back({e.effect, used_in});
  std::string head = "# " + printable(result.sentence) + "\n";
  for (const std::string& source : result.sources)
    head += "# traced from " + printable(source) + "\n";
  for (const TracedEffect& e : result.effects)
    if (!judged)
      head += fmt::format("# left out: {}, found in an interrupted trace and not judged\n",
                          e.effect->kind());
    else if (e.only_in_part)
      head += fmt::format("# left out: {}, found in a part of the data only\n", e.effect->kind());
    else if (e.only_in_log)
      head +=
          fmt::format("# left out: {}, an error of the log, not of the drive\n", e.effect->kind());
  for (const TracedEffect& e : result.stop_gaps)
    if (judged && !e.only_in_part)
      head += fmt::format("# {} is a stop-gap: it describes the data without a cause\n",
                          e.effect->kind());
  if (left_out > 0)
    head += fmt::format(
        "# left out: {} effects of the simulated plant; the traced effects replace them\n",
        left_out);
  return head + config.resolved_with(std::move(effects));
}

}  // namespace twinrate
