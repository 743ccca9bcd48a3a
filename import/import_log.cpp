#include "import/import_log.hpp"

#include <filesystem>

#include "core/manifest.hpp"
#include "core/paths.hpp"
#include "core/signals_io.hpp"
#include "import/drive_messages.hpp"
#include "import/whole_log.hpp"

namespace twinrate {
namespace {

using Json = nlohmann::ordered_json;

Json describe(const ImportRequest& request, const DriveRows& rows, const TickGrid& grid,
              const DriveMessages& messages, double f_s_Hz) {
  std::vector<std::string> left_out = rows.left_out;
  for (const std::string& name : messages.no_place()) left_out.push_back(name);
  const auto path = std::filesystem::path(request.file);
  return {
      {"file", path.filename().string()},
      {"bytes", std::filesystem::file_size(path)},
      {"fnv1a64", file_hash(request.file)},
      {"map", request.map.empty() ? "" : std::filesystem::path(request.map).filename().string()},
      {"rows", rows.size()},
      {"t_0_s", rows.t.front()},
      {"duration_s", rows.t.back() - rows.t.front()},
      {"f_s_Hz", f_s_Hz},
      {"dt_min_s", grid.dt_min_s},
      {"dt_median_s", grid.dt_median_s},
      {"dt_max_s", grid.dt_max_s},
      {"gaps", grid.gaps},
      {"missing_ticks", grid.missing},
      {"moved_rows", grid.moved},
      {"crowded_out_rows", grid.crowded_out},
      {"signals", messages.found()},
      {"left_out", left_out},
      {"notes", rows.notes}};
}

std::string manifest_json(std::int64_t session, const Json& source, const std::string& map_toml) {
  const Json json = {{"program", "twinrate import"},
                     {"revision", revision()},
                     {"session", session},
                     {"source", source},
                     {"map_toml", map_toml}};
  return json.dump(2);
}

void write_log(const ImportRequest& request, const TickGrid& grid, const DriveMessages& messages,
               const manifest_t& manifest, const ImportProgress& progress) {
  constexpr std::int64_t kFirst_us = 1'000'000;  // event time 0 means "not known"
  const std::int64_t session = manifest.session;
  WholeLog log(request.out);
  log.write(manifest, kFirst_us);
  for (std::size_t i = 0; i < grid.slots.size(); ++i) {
    const Measurement m = messages.measurement(grid.slots[i]);
    const std::int64_t t_us = kFirst_us + m.t_ns / 1000;
    log.write(to_wire(m, session), t_us);
    if (messages.has_reference())
      log.write(to_wire(messages.reference(grid.slots[i]), session), t_us);
    if (i % 16384 == 0)
      progress("writing", static_cast<double>(i) / static_cast<double>(grid.slots.size()));
  }
  log.finish();
}

}  // namespace

Json import_log(const ImportRequest& request, const ImportMap& map, const Config& config,
                const ImportProgress& progress) {
  const DriveConfig& drive = config.drive();
  const DriveRows rows =
      read_drive_rows(request.file, request.map.empty() ? nullptr : &map, request.repair,
                      [&](double share) { progress("reading", share); });
  const TickGrid grid = place_on_grid(rows, drive.rates.f_s_Hz);
  const DriveMessages messages(rows, drive.machine.n_p, drive.inverter.v_dc);
  const Json source = describe(request, rows, grid, messages, drive.rates.f_s_Hz);
  const std::string hash = source["fnv1a64"];
  const auto session = static_cast<std::int64_t>(std::stoull(hash, nullptr, 16) >> 1 | 1);
  write_log(request, grid, messages,
            make_manifest(session, config.resolved(), manifest_json(session, source, map.toml)),
            progress);
  return source;
}

}  // namespace twinrate
