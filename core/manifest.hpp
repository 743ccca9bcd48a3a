// DRIVE_MANIFEST: what makes a log self-contained.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "core/channels.hpp"

namespace twinrate {

// Host, versions, revision, seed as JSON.
std::string describe_host_json(std::int64_t session, int seed);
manifest_t make_manifest(std::int64_t session, const std::string& config_toml,
                         const std::string& manifest_json);
std::vector<std::uint8_t> encode(const manifest_t& manifest);

}  // namespace twinrate
