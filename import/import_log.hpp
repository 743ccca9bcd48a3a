// Imports a measured CSV as an LCM log.
#pragma once
#include <functional>
#include <nlohmann/json.hpp>
#include <string>

#include "core/config.hpp"
#include "import/map.hpp"

namespace twinrate {

struct ImportRequest {
  std::string file, map, out;  // map "": the header of the file holds canonical names
  bool repair = false;         // drops a truncated last line and repeated samples
};

// Receives the share done of `what`; may throw Stopped.
using ImportProgress = std::function<void(const std::string& what, double share)>;

// Reads the file, places its rows on the tick grid of the drive and writes the log. `map`: content
// of request.map. Returns the description of the source in the manifest. The session follows from
// the hash of the file: equal imports give equal logs. Throws BadInput, and what `progress` throws;
// the log is then not written.
nlohmann::ordered_json import_log(const ImportRequest& request, const ImportMap& map,
                                  const Config& config, const ImportProgress& progress);

}  // namespace twinrate
