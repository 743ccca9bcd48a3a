#include "core/manifest.hpp"

#include <fmt/format.h>
#include <sys/utsname.h>
#include <time.h>

#include <nlohmann/json.hpp>

#include "core/paths.hpp"

namespace twinrate {

std::string describe_host_json(std::int64_t session, int seed) {
  utsname host{};
  uname(&host);
  const std::time_t now = std::time(nullptr);
  char begun[32];
  std::strftime(begun, sizeof begun, "%Y-%m-%dT%H:%M:%SZ", std::gmtime(&now));
  const nlohmann::ordered_json json = {
      {"revision", revision()},
      {"session", session},
      {"seed", seed},
      {"begun", begun},
      {"host", {{"name", host.nodename}, {"kernel", host.release}, {"machine", host.machine}}},
      {"versions", {{"wire_schema", kWireSchema}, {"compiler", __VERSION__}}}};
  return json.dump(2);
}

std::optional<std::vector<std::string>> imported_signals(const std::string& manifest_json) {
  try {
    const auto json = nlohmann::json::parse(manifest_json);
    if (json.value("program", "") != "twinrate import") return {};
    return json.value("source", nlohmann::json::object())
        .value("signals", std::vector<std::string>{});
  } catch (const nlohmann::json::exception&) {  // of another program
    return {};
  }
}

manifest_t make_manifest(std::int64_t session, const std::string& config_toml,
                         const std::string& manifest_json) {
  manifest_t m{};
  m.seq = -1;
  m.session = session;
  m.schema = kWireSchema;
  m.revision = revision();
  m.config_toml = config_toml;
  m.manifest_json = manifest_json;
  return m;
}

std::vector<std::uint8_t> encode(const manifest_t& manifest) {
  const int size = manifest.getEncodedSize();
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(size));
  manifest.encode(bytes.data(), 0, size);
  return bytes;
}

}  // namespace twinrate
