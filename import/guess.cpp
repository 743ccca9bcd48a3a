#include "import/guess.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "core/config.hpp"
#include "import/guess_names.hpp"
#include "import/text_table.hpp"
#include "model/frames.hpp"

namespace twinrate {
namespace {

// Without a unit. Larger values, or values with fewer decimals, may be milliamperes or counts.
constexpr double kMax_A = 50, kMax_V = 1000;
constexpr int kMinDecimals = 3;
// Without a unit: in ms these spacings would be 1 ns to 20 us.
constexpr double kMinStep_s = 1e-6, kMaxStep_s = 0.02;

std::string tool_of(const std::vector<std::string>& names) {
  const auto has = [&](const char* name) {
    return std::find(names.begin(), names.end(), name) != names.end();
  };
  const auto any = [&](const char* part) {
    return std::any_of(names.begin(), names.end(), [&](const std::string& name) {
      return name.find(part) != std::string::npos;
    });
  };
  if (has("ms_today") && has("erpm")) return "vesc";
  if (any("servo_stats.")) return "moteus";
  if (any(".Iq_measured") || any("pos_vel_mapper.") || any("encoder.pos_estimate")) return "odrive";
  if (has("target") && has("voltage_q") && has("velocity")) return "simplefoc";
  return "";
}

const ToolColumn* tool_column(const std::string& tool, const std::string& name) {
  for (const ToolColumn& column : tool_columns())
    if (tool == column.tool &&
        (name == column.name || name.ends_with(std::string(".") + column.name)))
      return &column;
  return nullptr;
}

class Guesser {
 public:
  Guesser(const GuessRequest& request, Guess& guess, const std::vector<std::string>& lines,
          const Layout& layout, const Header& header)
      : request_(request), guess_(guess), lines_(lines), layout_(layout), header_(header) {
    for (const std::string& name : header.names) bare_names_.push_back(named_unit(name).name);
    // A header of canonical names, perhaps with columns of others between them.
    const auto canonical = std::count_if(header.names.begin(), header.names.end(), is_canonical);
    drive_log_ = has_name("t") && 2 * static_cast<std::size_t>(canonical) >= header.names.size();
  }

  GuessedColumn column(std::size_t i) const {
    GuessedColumn c{.name = header_.names[i], .number = static_cast<int>(i) + 1};
    if (c.name.empty()) {
      c.reason = "has no name";
      return c;
    }
    if (drive_log_ && is_canonical(c.name)) {
      c.canonical = c.name;
      c.unit_from = "the name of a drive log, SI";
      return c;
    }
    NamedUnit named = named_unit(c.name);
    if (c.name.ends_with("_A") && has_name(c.name.substr(0, c.name.size() - 1) + "B"))
      named = {c.name, ""};  // phase A beside phase B
    if (!header_.units[i].empty()) named = {c.name, header_.units[i]};
    if (named.unit.empty() && plain(named.name).ends_with("rpm") &&
        !plain(named.name).ends_with("erpm"))
      named.unit = "rpm";
    if (const ToolColumn* known = tool_column(guess_.tool, c.name)) {
      take_known(*known, c);
      return c;
    }
    take_named(named, i, c);
    return c;
  }

 private:
  static bool is_canonical(const std::string& name) {
    const auto& known = canonical_columns();
    return std::find(known.begin(), known.end(), name) != known.end();
  }
  bool has_name(const std::string& name) const {
    return std::find(header_.names.begin(), header_.names.end(), name) != header_.names.end();
  }

  void take_known(const ToolColumn& known, GuessedColumn& c) const {
    const std::string canonical = known.canonical;
    if (canonical.empty()) {
      c.reason = known.text;
      return;
    }
    if (guess_.tool == "simplefoc" && request_.tool.empty() && canonical.starts_with("i_")) {
      c.reason = "A or mA? monitor() of SimpleFOC writes mA; --from simplefoc takes it so";
      return;
    }
    if (known.electrical && !request_.n_p) {
      c.reason = fmt::format("{}; --drive gives the pole pairs", known.text);
      return;
    }
    c.canonical = canonical;
    c.scale = known.electrical ? known.scale / *request_.n_p : known.scale;
    c.unit_from = fmt::format("{}, as {} writes it", known.text, guess_.tool);
  }

  void take_named(const NamedUnit& named, std::size_t i, GuessedColumn& c) const {
    const Meaning meaning = meaning_of(named.name, bare_names_);
    if (meaning.canonical.empty()) {
      c.reason = meaning.reason.empty() ? "no signal of a drive log by its name" : meaning.reason;
      return;
    }
    if (named.unit.empty()) {
      take_without_unit(meaning, i, c);
      return;
    }
    const auto unit = unit_of(named.unit);
    if (!unit) {
      c.reason = fmt::format("the unit \"{}\" is not known here", named.unit);
      return;
    }
    if (unit->quantity != meaning.quantity) {
      c.reason = fmt::format("\"{}\" is no unit of {}", named.unit, meaning.canonical);
      return;
    }
    if (!unit->problem.empty()) {
      c.reason = unit->problem;
      return;
    }
    const bool turns = meaning.quantity == Quantity::kAngle || meaning.quantity == Quantity::kSpeed;
    if (turns && !unit->mechanical && !meaning.said_mechanical) {
      c.reason = fmt::format("{} of the shaft or of the electrical angle? the name does not say",
                             named.unit);
      return;
    }
    c.canonical = meaning.canonical;
    c.scale = unit->scale;
    c.offset = unit->offset;
    c.unit_from = named.unit;
  }

  static void take_angle_without_unit(const Meaning& meaning, const Values& values,
                                      GuessedColumn& c) {
    const bool in_rad = values.restarts_at(kTwoPi);
    if (!meaning.said_mechanical) {
      c.reason = "mechanical or electrical, and in which unit? the name does not say";
    } else if (!in_rad && !values.restarts_at(360)) {
      c.reason = "rad, deg or turns? no unit in the file";
    } else {
      c.canonical = meaning.canonical;
      c.scale = in_rad ? 1 : kTwoPi / 360;
      c.unit_from = in_rad ? "rad by its values, which restart at 2 pi: no unit in the file"
                           : "deg by its values, which restart at 360: no unit in the file";
    }
  }

  void take_without_unit(const Meaning& meaning, std::size_t i, GuessedColumn& c) const {
    const Values values = values_of(lines_, layout_, i);
    const double max = values.max_abs(), step = values.median_step();
    const auto take_if = [&](bool plausible, std::string unit_from, std::string reason) {
      if (!plausible) {
        c.reason = std::move(reason);
        return;
      }
      c.canonical = meaning.canonical;
      c.scale = 1;
      c.unit_from = std::move(unit_from);
    };
    const char* const unknown = "its unit is not in the file";
    switch (meaning.quantity) {
      case Quantity::kCurrent:
        return take_if(max <= kMax_A && values.decimals >= kMinDecimals,
                       fmt::format("A by its values, up to {:.3g}: no unit in the file", max),
                       fmt::format("A or mA? no unit in the file, values up to {:.3g}", max));
      case Quantity::kVoltage:
        return take_if(max <= kMax_V && values.decimals >= 1,
                       fmt::format("V by its values, up to {:.3g}: no unit in the file", max),
                       fmt::format("V or mV? no unit in the file, values up to {:.3g}", max));
      case Quantity::kTime:
        return take_if(step >= kMinStep_s && step <= kMaxStep_s,
                       fmt::format("s by its steps of {:.3g}: no unit in the file", step),
                       fmt::format("s, ms or us? no unit in the file, steps of {:.3g}", step));
      case Quantity::kAngle:
        return take_angle_without_unit(meaning, values, c);
      case Quantity::kDuty:
        return take_if(max > 0.05 && std::all_of(values.x.begin(), values.x.end(),
                                                 [](double v) { return v >= 0 && v <= 1; }),
                       "0 to 1 by its values", unknown);
      case Quantity::kSpeed:
        c.reason = "rad/s or rpm, mechanical or electrical? no unit in the file";
        return;
      default:
        c.reason = unknown;
    }
  }

  const GuessRequest& request_;
  const Guess& guess_;
  const std::vector<std::string>& lines_;
  const Layout& layout_;
  const Header& header_;
  std::vector<std::string> bare_names_;
  bool drive_log_ = false;
};

void drop(GuessedColumn& column, std::string reason) {
  column.canonical.clear();
  column.reason = std::move(reason);
}

// Two columns with one meaning: neither is taken.
void drop_doubles(std::vector<GuessedColumn>& columns) {
  std::map<std::string, std::vector<GuessedColumn*>> by_name;
  for (GuessedColumn& c : columns)
    if (!c.canonical.empty()) by_name[c.canonical].push_back(&c);
  for (const auto& [name, doubles] : by_name) {
    if (doubles.size() < 2) continue;
    std::vector<std::string> numbers;
    for (const GuessedColumn* c : doubles) numbers.push_back(std::to_string(c->number));
    for (GuessedColumn* c : doubles)
      drop(*c, fmt::format("columns {} all read as {}", fmt::join(numbers, ", "), name));
  }
}

void note_the_rest(Guess& guess) {
  const bool time = guess.has("t");
  const bool time_named =
      std::any_of(guess.columns.begin(), guess.columns.end(), [](const GuessedColumn& c) {
        return meaning_of(named_unit(c.name).name, {}).quantity == Quantity::kTime;
      });
  const auto& fixed = static_columns();
  for (GuessedColumn& c : guess.columns)
    if ((time || time_named) && std::find(fixed.begin(), fixed.end(), c.canonical) != fixed.end())
      drop(c, "of sets without time only; a drive log has u_alpha, u_beta or u_d, u_q");
  if (!time) guess.notes.emplace_back("no time column is recognised: a drive log needs [time]");
  const bool dq = guess.has("i_d") || guess.has("i_q");
  if (time && dq && !guess.has("theta_m"))
    guess.notes.emplace_back(
        "i_d, i_q stand in the frame of the drive that wrote them; without theta_m they give no "
        "phase currents");
}

}  // namespace

const std::vector<std::string>& known_tools() {
  static const std::vector<std::string> tools{"vesc", "odrive", "moteus", "simplefoc", "matlab"};
  return tools;
}

bool Guess::has(const std::string& canonical) const {
  return std::any_of(columns.begin(), columns.end(),
                     [&](const GuessedColumn& c) { return c.canonical == canonical; });
}

Guess guess_map(const GuessRequest& request) {
  const bool mat = request.file.ends_with(".mat");
  if (!request.tool.empty() &&
      std::find(known_tools().begin(), known_tools().end(), request.tool) == known_tools().end())
    throw BadInput(
        fmt::format("--from {}: one of {} allowed", request.tool, fmt::join(known_tools(), ", ")));
  if (request.tool == "matlab" && !mat)
    throw BadInput(fmt::format("--from matlab: {} does not end in .mat", request.file));
  const std::vector<std::string> lines = first_lines(request.file);
  const Layout layout = best_layout(request.file, lines);
  Header header = header_of(lines, layout);
  Guess guess{.path = request.file};
  guess.numbered = make_utf8(header) || header.by_number;
  guess.tool =
      request.tool.empty() || request.tool == "matlab" ? tool_of(header.names) : request.tool;
  if (!request.tool.empty() && request.tool != "matlab" &&
      std::none_of(header.names.begin(), header.names.end(), [&](const std::string& name) {
        return tool_column(request.tool, name) || tool_column(request.tool, named_unit(name).name);
      }))
    throw BadInput(fmt::format("--from {}: {} has no column that {} writes; it has {}",
                               request.tool, request.file, request.tool,
                               fmt::join(header.names, ", ")));
  guess.format.separator = layout.separator;
  guess.format.decimal = layout.decimal;
  guess.format.skip = static_cast<int>(header.skip);
  guess.format.header = !header.by_number;
  const Guesser guesser(request, guess, lines, layout, header);
  for (std::size_t i = 0; i < layout.fields; ++i) {
    if (i + 1 == layout.fields && header.names[i].empty()) break;  // after the last separator
    guess.columns.push_back(guesser.column(i));
  }
  drop_doubles(guess.columns);
  note_the_rest(guess);
  return guess;
}

}  // namespace twinrate
