#include "tests/support/option_probe.hpp"

#include <fmt/ranges.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstring>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "controller/controller.hpp"
#include "estimator/registry.hpp"
#include "loop/closed_loop.hpp"
#include "loop/load_drive.hpp"
#include "loop/runnable.hpp"
#include "loop/unused_keys.hpp"
#include "tests/support/option_situations.hpp"

namespace twinrate::test {
namespace {

// Longer than alignment, ramp and hand-over of kShortStart.
constexpr double kDuration_s = 0.3;
constexpr double kLongest_s = 1;

// Of the values of a tick, bit by bit.
class Digest {
 public:
  void add(double value) {
    std::uint64_t bits = 0;
    std::memcpy(&bits, &value, sizeof bits);
    add_bits(bits);
  }
  void add(const Eigen::Ref<const Eigen::MatrixXd>& values) {
    for (Eigen::Index i = 0; i < values.size(); ++i) add(values.reshaped()[i]);
  }
  void add_bits(std::uint64_t bits) { hash_ = (hash_ ^ bits) * 0x100000001b3ULL ^ (hash_ >> 29); }
  std::uint64_t value() const { return hash_; }

 private:
  std::uint64_t hash_ = 0xcbf29ce484222325ULL;
};

std::uint64_t digest(const TickRecord& tick) {
  Digest d;
  const Measurement& m = tick.measurement;
  d.add(m.i_abc), d.add(m.u_alphabeta), d.add(m.v_dc), d.add(m.theta_m), d.add(m.omega_m);
  d.add(tick.truth.i_dq), d.add(tick.truth.omega_m), d.add(tick.truth.theta_m);
  const Estimate& e = tick.estimate;
  d.add(e.theta_e), d.add(e.omega_m), d.add(e.T_load), d.add(e.x_hat), d.add(e.status);
  if (tick.has_gain) d.add(tick.gain.K), d.add(tick.gain.P);
  d.add(tick.reference.omega_m_ref), d.add(tick.reference.i_d_ref);
  d.add(tick.command.u_alphabeta_ref), d.add(tick.command.i_dq_ref);
  d.add(static_cast<int>(tick.command.mode)), d.add(static_cast<int>(tick.event.reason));
  for (const PlantEvent& event : tick.plant_events) d.add(static_cast<int>(event.reason));
  return d.value();
}

// The warnings of the check of a run and its ticks, by their digests.
struct Run {
  std::vector<std::string> warnings;
  std::vector<std::uint64_t> ticks;
};

std::int64_t steps_of(Config& config) {
  const DriveConfig& d = config.drive();
  return static_cast<std::int64_t>(std::min(d.run.duration_s, kLongest_s) * d.rates.f_s_Hz);
}

// Throws BadInput.
Run run_of(const Pairing& p, const Overrides& overrides) {
  Run run;
  Config config = load_drive(p.preset, overrides);
  run.warnings = texts_of(check_runnable(config));
  ClosedLoop loop(config);
  for (const std::int64_t steps = steps_of(config); loop.k() < steps;)
    run.ticks.push_back(digest(loop.step()));
  return run;
}

// The ticks first: the theory behind a warning takes longer than a run. Throws BadInput.
bool differs(const Pairing& p, const Overrides& overrides, const Run& from) {
  Config config = load_drive(p.preset, overrides);
  refuse_unused_keys(config);
  {
    ClosedLoop loop(config);
    for (const std::int64_t steps = steps_of(config); loop.k() < steps;) {
      const auto k = static_cast<std::size_t>(loop.k());
      if (k >= from.ticks.size() || from.ticks[k] != digest(loop.step())) return true;
    }
    if (static_cast<std::size_t>(loop.k()) != from.ticks.size()) return true;
  }
  return texts_of(check_runnable(config)) != from.warnings;
}

// "12T": twelve times the rated torque of the preset's machine; "2I": its rated current; "1.5L": L_d;
// "0.3N": of the speed, in rpm, at which its EMF is the voltage limit.
Overrides in_SI(const Overrides& list, const std::string& preset) {
  const DriveConfig drive = load_drive(preset, {}).drive();
  const MachineParameters& machine = drive.machine;
  const double I = machine.i_rated > 0 ? machine.i_rated : 1;
  const std::map<char, double> units{
      {'T', machine.T_rated > 0 ? machine.T_rated : machine.torque_constant() * I},
      {'I', I},
      {'L', machine.L_d},
      {'N', drive.inverter.v_dc / (std::sqrt(3.0) * machine.psi_f * machine.n_p) * 60 / kTwoPi}};
  Overrides all;
  for (const std::string& one : list) {
    std::string text;
    for (std::size_t i = 0; i < one.size();) {
      const std::size_t end = std::min(one.find_first_not_of("0123456789.", i), one.size());
      if (std::isdigit(one[i]) && end < one.size() && units.contains(one[end])) {
        text += fmt::format("{:.6g}", units.at(one[end]) * std::stod(one.substr(i, end - i)));
        i = end + 1;
      } else {
        text += one[i++];
      }
    }
    all.push_back(text);
  }
  return all;
}

// A start by alignment within kDuration_s; the load begins with it.
Overrides base_of(const Pairing& p) {
  Overrides list = {"estimator.kind=" + p.estimator,
                    "controller.kind=" + p.controller,
                    "start=" + p.start,
                    "rates.n=3",
                    "load.T_load_Nm=0.12T",
                    fmt::format("run.duration_s={}", kDuration_s),
                    "run.settle_s=0.1"};
  if (p.start == "align_if")
    for (const char* key : {"t_align_s=0.03", "acceleration_rad_s2=4000.0",
                            "omega_e_handover_rad_s=200.0", "t_agree_s=0.01"})
      list.push_back(fmt::format("controller.{}.startup.{}", p.controller, key));
  return in_SI(list, p.preset);
}

bool fits(const std::string& pattern, const std::string& key) {
  return pattern.ends_with('.') ? key.starts_with(pattern) : key == pattern;
}

std::string with_table(std::string text, const std::string& controller) {
  const std::string mark = "CONTROLLER";
  if (text.starts_with(mark)) text.replace(0, mark.size(), "controller." + controller);
  return text;
}

std::vector<std::string> other_numbers(const FieldRow& row) {
  const bool whole = row.type == "whole number";
  std::set<double> seen{row.value};
  std::vector<std::string> list;
  const auto add = [&](double value) {
    value = std::clamp(whole ? std::round(value) : value, row.lo, row.hi);
    if (seen.insert(value).second)
      list.push_back(whole ? fmt::format("{:.0f}", value) : fmt::format("{:.12e}", value));
  };
  for (const double factor : {2.0, 0.5, 0.1, 10.0}) add(row.value * factor);
  if (whole) add(row.value + 1);
  for (const double value : {1e-3, 0.05, 1.0, 30.0, 1e3}) add(value);
  add(row.lo), add(row.hi);
  return list;
}

// All elements by one factor, and all at one value.
std::vector<std::string> other_lists(const FieldRow& row) {
  std::vector<double> values;
  const char* at = row.value_text.c_str() + 1;
  for (char* end = nullptr; *at && *at != ']'; at = *end == ',' ? end + 1 : end)
    values.push_back(std::strtod(at, &end));
  const bool whole = row.type == "whole numbers";
  if (whole) return {"[2, 5]", "[1]"};
  std::vector<std::string> list;
  const auto add = [&](auto&& of) {
    std::vector<double> other;
    other.reserve(values.size());
    for (const double v : values) other.push_back(std::clamp(of(v), row.lo, row.hi));
    if (other != values) list.push_back(fmt::format("[{:.12e}]", fmt::join(other, ", ")));
  };
  for (const double factor : {2.0, 0.5, 0.1, 10.0}) add([=](double v) { return v * factor; });
  for (const double value : {0.01, 1.0}) add([=](double) { return value; });
  return list;
}

// Values that a range does not show.
const std::map<std::string, std::vector<std::string>> kValues = {
    {"rates.f_b_Hz", {"5000.0", "2000.0"}},
    {"rates.n_from", {"start", "locked"}},
    {"steering.n", {"7", "[[0.0, 0], [0.1, 7]]"}},
    {"steering.policy", {"immediate", "[[0.0, \"gain.policy\"], [0.1, \"immediate\"]]"}}};

std::vector<std::string> other_values(const FieldRow& row, const std::string& key) {
  if (const auto known = kValues.find(key); known != kValues.end()) return known->second;
  std::vector<std::string> list;
  if (row.type == "boolean") return {row.value_text == "true" ? "false" : "true"};
  if (row.type == "choice") {
    for (const std::string& choice : row.choices)
      if (choice != row.value_text) list.push_back(choice);
    return list;
  }
  if (row.type == "numbers" || row.type == "whole numbers") return other_lists(row);
  if (row.type == "number" || row.type == "whole number") return other_numbers(row);
  if (row.type == "profile") {
    const double v = row.value;
    for (const double other : {2 * v, 0.5 * v, v + 1, v - 1, 0.0})
      if (other != v) list.push_back(fmt::format("{:.6f}", std::clamp(other, row.lo, row.hi)));
    return list;
  }
  return {};
}

// The refusal of an option names it and has one line.
bool names(const std::string& refusal, const std::string& key) {
  return refusal.find(": " + key + ":") != std::string::npos &&
         refusal.find('\n') == std::string::npos;
}

bool left_out(const std::string& key) {
  static const std::set<std::string> keys{"estimator.kind", "controller.kind"};
  return keys.contains(key);
}

}  // namespace

std::vector<Option> options_of(const Pairing& p) {
  Config config = load_drive(p.preset, base_of(p));
  DriveConfig d = config.drive();
  std::vector<Option> options;
  const auto add = [&](const std::string& path, const std::function<void(FieldVisitor&)>& fields) {
    for (const FieldRow& row : list_fields(fields)) {
      const std::string key = path + "." + row.key;
      if (!left_out(key) && row.type != "text")
        options.push_back({key, row, other_values(row, key)});
    }
  };
  const auto add_section = [&](const char* path, auto& section) {
    add(path, [&](FieldVisitor& f) { section.fields(f); });
  };
  add_section("machine", d.machine), add_section("inverter", d.inverter);
  add_section("sensors", d.sensors), add_section("rates", d.rates), add_section("gain", d.gain);
  add_section("reference", d.reference), add_section("load", d.load), add_section("run", d.run);
  add_section("estimator", d.estimator), add_section("controller", d.controller);
  for (const OwnedTable& table : owned_tables()) {
    config.read_table(table.path, table.fields);
    add(table.path, table.fields);
  }
  const auto add_kind = [&](const std::string& path, const auto& builder) {
    const auto fields = [&](FieldVisitor& f) { builder->fields(f); };
    if (config.has_table(path)) config.read_table(path, fields);
    add(path, fields);
  };
  for (const std::string& kind : filter_kinds())
    add_kind("estimator." + kind, filter_builder(kind, d));
  for (const std::string& kind : controller_kinds())
    add_kind("controller." + kind, controller_builder(kind, d));
  return options;
}

namespace {

// As the drive file has it; then what a pairing that is lost before it reads the option needs: a start at
// speed, and a machine whose rotor every filter models.
std::vector<Overrides> variants_of(const Pairing& p, const std::string& key) {
  static const std::set<std::string> of_the_start{"t_agree_s", "t_give_up_s", "t_fade_s"};
  std::vector<Overrides> list{{}};
  const bool from_any_start = !of_the_start.contains(key.substr(key.rfind('.') + 1));
  const MachineParameters machine = load_drive(p.preset, {}).drive().machine;
  const std::string round = fmt::format("machine.L_q_H={:.9g}", machine.L_d);
  if (from_any_start) list.push_back({"start=flying"});
  if (machine.L_d != machine.L_q) list.push_back({round});
  if (machine.L_d != machine.L_q && from_any_start) list.push_back({"start=flying", round});
  return list;
}

struct Base {
  Overrides all;
  std::string with;  // beyond the first one
};

std::vector<Base> bases_of(const Pairing& p, const std::string& key) {
  std::vector<Base> bases;
  const auto add = [&](const Overrides& variant, bool last) {
    Pairing other = p;
    Overrides rest;
    for (const std::string& one : variant)
      if (one == "start=flying")
        other.start = "flying";
      else
        rest.push_back(one);
    const Overrides base = joined(base_of(other), rest);
    if (!last) bases.push_back({base, fmt::format("{}", fmt::join(variant, " "))});
    for (const Situation& s : situations()) {
      if (s.last != last || !fits(with_table(s.key, p.controller), key)) continue;
      Overrides with;
      for (const std::string& one : s.with) with.push_back(with_table(one, p.controller));
      const Overrides with_variant = joined(variant, with);
      bases.push_back(
          {joined(base, in_SI(with, p.preset)), fmt::format("{}", fmt::join(with_variant, " "))});
    }
  };
  for (const bool last : {false, true})
    for (const Overrides& variant : variants_of(p, key)) add(variant, last);
  return bases;
}

}  // namespace

struct OptionProber::Runs {
  std::map<std::string, std::optional<Run>> without;  // by the overrides; none: refused
  std::string failure;                                // of a run without the option
};

OptionProber::OptionProber(Pairing pairing)
    : pairing_(std::move(pairing)), runs_(std::make_unique<Runs>()) {}
OptionProber::~OptionProber() = default;

OptionProbe OptionProber::probe(const Option& option) {
  const auto without = [&](const Overrides& list) -> const std::optional<Run>& {
    const std::string text = fmt::format("{}", fmt::join(list, " "));
    const auto known = runs_->without.find(text);
    if (known != runs_->without.end()) return known->second;
    std::optional<Run> run;
    try {
      run = run_of(pairing_, list);
    } catch (const BadInput&) {
    } catch (const std::exception& error) {
      runs_->failure = text + ": " + error.what();
    }
    return runs_->without[text] = std::move(run);
  };
  const std::vector<Base> bases = bases_of(pairing_, option.key);
  const auto elsewhere = std::find_if(acts_elsewhere().begin(), acts_elsewhere().end(),
                                      [&](const auto& one) { return fits(one.first, option.key); });
  const bool is_elsewhere = elsewhere != acts_elsewhere().end();
  std::string refusal;
  bool ran = false;
  for (const auto& [base, with] : bases) {
    const std::optional<Run>& before = without(base);
    if (!runs_->failure.empty())
      return {OptionAnswer::kError, std::exchange(runs_->failure, {}), {}};
    if (!before) continue;
    for (const std::string& value : option.set) {
      try {
        const bool changes = differs(pairing_, joined(base, {option.key + "=" + value}), *before);
        ran = true;
        if (changes) return {OptionAnswer::kChanges, value, with};
        if (is_elsewhere && option.row.type != "choice") break;
      } catch (const BadInput& error) {
        const std::string line = error.what();
        if (line.find('\n') != std::string::npos) return {OptionAnswer::kError, line, {}};
        if (!names(line, option.key))
          return {OptionAnswer::kChanges, fmt::format("{}: {}", value, line), with};
        refusal = line;
        // Rules on numbers do not depend on the value.
        if (option.row.type != "choice" && option.row.type != "boolean" &&
            line.find("has no effect here") != std::string::npos)
          break;
      } catch (const std::exception& error) {
        return {OptionAnswer::kError, option.key + "=" + value + ": " + error.what(), {}};
      }
    }
  }
  if (ran && is_elsewhere) return {OptionAnswer::kElsewhere, elsewhere->second, {}};
  if (!ran && !refusal.empty()) return {OptionAnswer::kRefused, refusal, {}};
  return {OptionAnswer::kSilent, refusal, {}};
}

}  // namespace twinrate::test
