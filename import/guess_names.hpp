// Names and units of foreign columns, and their meaning in a drive log.
#pragma once
#include <optional>
#include <string>
#include <vector>

namespace twinrate {

enum class Quantity {
  kNone,
  kTime,
  kCurrent,
  kVoltage,
  kAngle,
  kSpeed,
  kTorque,
  kTemperature,
  kFlux,
  kDuty
};

// A column name without its unit: "Phase Current A [mA]" is {"phase current A", "mA"}.
struct NamedUnit {
  std::string name, unit;
};
NamedUnit named_unit(const std::string& column);

struct Unit {
  Quantity quantity = Quantity::kNone;
  double scale = 1, offset = 0;  // to SI (degC for a temperature)
  bool mechanical = false;       // rpm, rev/s: of a shaft
  std::string problem;           // why the unit alone is not enough; else ""
};
// None for a text that is no known unit.
std::optional<Unit> unit_of(const std::string& text);

// The meaning of a name, apart from its unit. `canonical` empty: `reason` gives the reason.
struct Meaning {
  std::string canonical;
  Quantity quantity = Quantity::kNone;
  bool said_mechanical = false;  // "mech", "shaft", "omega_m": of an angle or a speed
  std::string reason;
};
// `columns`: all names of the file without their units; "id" is a current beside an "iq" only.
Meaning meaning_of(const std::string& name, const std::vector<std::string>& columns);

// Lower case, letters and digits only: "Iq_meas" is "iqmeas".
std::string plain(const std::string& name);

// Columns of known tools, by the end of their name after the last dot or by the whole name.
struct ToolColumn {
  const char* tool;
  const char* name;
  const char* canonical;  // "": `text` gives the reason why it has no place in a drive log
  double scale = 1;
  bool electrical = false;  // divide by the pole pairs
  const char* text = "";    // the unit in the tool's words, or the reason
};
const std::vector<ToolColumn>& tool_columns();

}  // namespace twinrate
