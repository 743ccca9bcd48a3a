// DRIVE_MANIFEST: config, host and versions, which make a log self-contained.
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
// The signals that `twinrate import` found in a measured log, in words. The references and loads of
// its drive file were not measured. Empty for a run.
std::optional<std::vector<std::string>> imported_signals(const std::string& manifest_json);
std::vector<std::uint8_t> encode(const manifest_t& manifest);

}  // namespace twinrate
