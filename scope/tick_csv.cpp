#include "scope/tick_csv.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>

#include "core/config.hpp"
#include "core/declared_load.hpp"
#include "model/signals.hpp"

namespace twinrate::scope {
namespace {

struct Column {
  std::string head;
  std::vector<double> values;
};

bool is_in_all(const std::vector<Column>& columns, std::size_t row) {
  return std::none_of(columns.begin(), columns.end(),
                      [row](const Column& c) { return std::isnan(c.values[row]); });
}

void append_row(std::string& text, const std::vector<Column>& columns, std::size_t row) {
  auto out = std::back_inserter(text);
  for (const Column& c : columns)
    if (std::isnan(c.values[row]))
      text += ',';
    else
      fmt::format_to(out, ",{:.17g}", c.values[row]);
  text += '\n';
}

std::string heads(const std::string& first, const std::vector<Column>& columns) {
  std::string text = first;
  for (const Column& c : columns) text += "," + c.head;
  return text + "\n";
}

// The signals measured at any tick of the range; a message also has numbers for signals that are
// not measured.
int measured_in(const Recording& recording, const Span& span) {
  int bits = 0;
  for (const double value : recording.samples("measurement.signals", span))
    if (!std::isnan(value)) bits |= static_cast<int>(value);
  return bits;
}

// The load of the drive file and of the requests, because that of DRIVE_TRUTH includes effects of
// the plant. Empty if requests may be missing.
std::vector<double> declared_load(const Recording& recording, const Span& span) {
  const DriveFileFacts facts = recording.drive();
  const auto requests = recording.requests();
  if (facts.config_toml.empty() || facts.imported || !requests) return {};
  Config config = Config::parse(facts.config_toml, "the drive file");
  DeclaredLoad load(config.drive());
  for (const AppliedSteering& request : *requests) load.steer(request.k, request.lines);
  std::vector<double> values;
  for (std::int64_t k = 0; k < span.to; ++k) {
    const double T_load = load.at(static_cast<double>(k) * facts.T_s);
    if (k >= span.from) values.push_back(T_load);
  }
  return values;
}

}  // namespace

std::string ticks_csv(const Recording& recording, const std::vector<std::string>& signals,
                      Span span) {
  span.bucket = 1;
  std::vector<Column> columns;
  columns.reserve(signals.size());
  for (const std::string& signal : signals)
    columns.push_back({signal, recording.samples(signal, span)});
  const double T_s = recording.drive().T_s;
  std::string text = heads("k,t_s", columns);
  for (std::int64_t k = span.from; k < span.to; ++k) {
    fmt::format_to(std::back_inserter(text), "{},{:.9g}", k, static_cast<double>(k) * T_s);
    append_row(text, columns, static_cast<std::size_t>(k - span.from));
  }
  return text;
}

std::string drive_log_csv(const Recording& recording, Span span) {
  struct Source {
    const char *head, *signal;
    int bit;
  };
  constexpr Source kSources[] = {{"i_a", "measurement.i_a_A", kPhaseCurrents},
                                 {"i_b", "measurement.i_b_A", kPhaseCurrents},
                                 {"i_c", "measurement.i_c_A", kPhaseCurrents},
                                 {"u_alpha", "measurement.u_alpha_V", kVoltage},
                                 {"u_beta", "measurement.u_beta_V", kVoltage},
                                 {"v_dc", "measurement.v_dc_V", kBusVoltage},
                                 {"theta_m", "measurement.theta_m_rad", kPosition},
                                 {"omega_m", "measurement.omega_m_rad_s", kSpeed}};
  span.bucket = 1;
  const int measured = measured_in(recording, span);
  if (!(measured & kPhaseCurrents) || measured & kQCurrentOnly)
    throw BadInput("a drive log: the phase currents were not measured there");
  std::vector<Column> columns;
  for (const Source& source : kSources) {
    if (!(measured & source.bit)) continue;
    Span at = span;
    if (source.bit == kVoltage) ++at.from, ++at.to;
    columns.push_back({source.head, recording.samples(source.signal, at)});
  }
  if (std::vector<double> load = declared_load(recording, span); !load.empty())
    columns.push_back({"T_load", std::move(load)});
  const double T_s = recording.drive().T_s;
  std::string text = heads("t", columns);
  for (std::int64_t k = span.from; k < span.to; ++k) {
    const auto row = static_cast<std::size_t>(k - span.from);
    if (!is_in_all(columns, row)) continue;
    fmt::format_to(std::back_inserter(text), "{:.9g}", static_cast<double>(k) * T_s);
    append_row(text, columns, row);
  }
  return text;
}

}  // namespace twinrate::scope
