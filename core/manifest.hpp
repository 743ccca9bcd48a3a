// DRIVE_MANIFEST: what makes a log self-contained.
#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "core/channels.hpp"

namespace twinrate {

// Host, versions, revision, seed as JSON.
std::string describe_host_json(std::int64_t session, int seed);
manifest_t make_manifest(std::int64_t session, const std::string& config_toml,
                         const std::string& manifest_json);
// Of a log that `twinrate import` made: the signals it found, in words. What its drive file says of
// references and loads is not what was measured. Empty for a run.
std::optional<std::vector<std::string>> imported_signals(const std::string& manifest_json);
std::vector<std::uint8_t> encode(const manifest_t& manifest);

}  // namespace twinrate
