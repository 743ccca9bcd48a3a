// effect_gallery DIR [KIND ...]: one page and one figure an effect, DIR/effects-gallery.md and
// DIR/effects/.
//
//   for each effect: [closed loop with it, and without] -> signal, order spectrum, visible place
//
// The drive is niewiara2020 with exact sensors, its paper's controller without compensation, 2 Nm,
// 60 rpm; the effect alone. kOverSpeed: a ramp from -60 to 60 rpm without the 2 Nm.
#include <fmt/format.h>

#include <filesystem>
#include <fstream>
#include <iostream>
#include <set>

#include "analysis/order_spectrum.hpp"
#include "core/field_list.hpp"
#include "loop/closed_loop.hpp"
#include "model/effects/catalogue.hpp"
#include "report/svg.hpp"
#include "tools/gallery/entries.hpp"

namespace twinrate::gallery {
namespace {

namespace fs = std::filesystem;

constexpr const char* kDrive =
    "preset = \"niewiara2020\"\n"
    "[sensors]\ni_noise_rms_A = 0.0\ni_lsb_A = 0.0\nencoder_counts = 0\n"
    "[controller]\ncompensation = \"off\"\n";
constexpr const char* kSteady =
    "[reference]\nspeed_rpm = 60.0\n[load]\nT_load_Nm = 2.0\n[run]\nduration_s = 8.2\n";
constexpr const char* kRamp =
    "[reference]\nspeed_rpm = [[0, -60], [4, 60]]\nslew_rad_s2 = 6.3\n[run]\nduration_s = 10.5\n";
constexpr const char* kReversal =
    "[reference]\nspeed_rpm = [[0, 60], [3.5, -60]]\n[load]\nT_load_Nm = 0.0\n"
    "[run]\nduration_s = 8.2\n";
constexpr double kSettle = 4;  // s, of kSteady

// Relative to `rated`, for the bars.
struct SignalInfo {
  const char *name, *meaning, *unit;
  double rated;
};
constexpr SignalInfo kSignals[] = {
    {"i_d true", "true d current", "A", 7.07},
    {"i_q true", "true q current", "A", 7.07},
    {"i_d", "measured d current", "A", 7.07},
    {"i_q", "measured q current", "A", 7.07},
    {"u_d", "d voltage, as the drive believes", "V", 136},
    {"u_q", "q voltage, as the drive believes", "V", 136},
    {"omega_m", "true speed", "rad/s", 6.28},
    {"T_o", "estimated load torque", "Nm", 8.1},
    {"v_dc", "measured bus voltage", "V", 235.4},
    {"theta error", "angle reading less true angle, mechanical", "rad", 1},
};
constexpr std::size_t kSignalCount = std::size(kSignals);

struct Trace {
  std::vector<double> t, theta_m, omega_m;
  std::vector<double> signals[kSignalCount];
};

Trace run(const std::string& how, const std::string& effects,
          const std::vector<std::string>& overrides = {}) {
  Config config = Config::parse(std::string(kDrive) + how + effects, "gallery", overrides);
  ClosedLoop loop(config);
  const DriveConfig& drive = config.drive();
  Trace trace;
  for (std::int64_t k = 0; k < drive.steps(); ++k) {
    const TickRecord& tick = loop.step();
    const Measurement& m = tick.measurement;
    const int n_p = drive.machine.n_p;
    const Vec2 i_dq = park(clarke(m.i_abc), n_p * m.theta_m);
    const Vec2 u_dq =
        park(m.u_alphabeta, n_p * (tick.truth.theta_m - 0.5 * drive.T_s() * tick.truth.omega_m));
    const double row[] = {tick.truth.i_dq[0],
                          tick.truth.i_dq[1],
                          i_dq[0],
                          i_dq[1],
                          u_dq[0],
                          u_dq[1],
                          tick.truth.omega_m,
                          tick.estimate.T_load,
                          m.v_dc,
                          m.theta_m - tick.truth.theta_m};
    trace.t.push_back(static_cast<double>(k) * drive.T_s());
    trace.theta_m.push_back(tick.truth.theta_m);
    trace.omega_m.push_back(tick.truth.omega_m);
    for (std::size_t s = 0; s < kSignalCount; ++s) trace.signals[s].push_back(row[s]);
  }
  return trace;
}

std::size_t index_at(const Trace& trace, double t) {
  return static_cast<std::size_t>(std::lower_bound(trace.t.begin(), trace.t.end(), t) -
                                  trace.t.begin());
}

// At most 700 points of [from, to).
Curve curve(const Trace& trace, Portrait::Signal signal, Portrait::Over over,
            const std::string& name, const std::string& colour, double from_s, double to_s) {
  Curve c{name, colour, {}, {}};
  const std::size_t first = index_at(trace, from_s), last = index_at(trace, to_s);
  const std::size_t step = std::max<std::size_t>(1, (last - first) / 700);
  for (std::size_t i = first; i < last; i += step) {
    c.x.push_back(over == Portrait::kOverTurns ? (trace.theta_m[i] - trace.theta_m[first]) / kTwoPi
                  : over == Portrait::kOverSpeed ? trace.omega_m[i]
                                                 : trace.t[i]);
    c.y.push_back(trace.signals[static_cast<int>(signal)][i]);
  }
  return c;
}

struct Part {
  double mean = 0, rms = 0;
  OrderSpectrum spectrum;
};
Part part_of(const Trace& trace, std::size_t signal, int orders) {
  const std::size_t first = index_at(trace, kSettle);
  const std::span<const double> values(trace.signals[signal].begin() + first,
                                       trace.signals[signal].end());
  Part part;
  part.spectrum =
      order_spectrum({trace.theta_m.begin() + first, trace.theta_m.end()}, values, orders);
  part.mean = part.spectrum.mean;
  part.rms = part.spectrum.rms(orders);
  return part;
}

// "3, 6, 18": the orders that hold at least a seventh of the largest.
std::string strongest(const OrderSpectrum& spectrum) {
  double largest = 0;
  for (double a : spectrum.amplitude) largest = std::max(largest, a);
  std::string list;
  int count = 0;
  for (std::size_t i = 0; i < spectrum.amplitude.size() && count < 4; ++i)
    if (spectrum.amplitude[i] > 0.15 * largest)
      list += fmt::format("{}{}", count++ ? ", " : "", i + 1);
  return list;
}

std::vector<Line> where_it_shows(const Trace& with, const Trace& without, int orders) {
  std::vector<Line> lines;
  for (std::size_t s = 0; s < kSignalCount; ++s) {
    const Part a = part_of(with, s, orders), b = part_of(without, s, orders);
    const SignalInfo& info = kSignals[s];
    const double shift = a.mean - b.mean, relative = a.rms / info.rated;
    std::string text = "no ripple";
    if (relative > 2e-7)
      text =
          fmt::format("ripple {:.2g} {} rms, orders {}", a.rms, info.unit, strongest(a.spectrum));
    if (std::abs(shift) > 1e-4 * info.rated)
      text += fmt::format("; mean {:+.2g} {}", shift, info.unit);
    // A decade is a fifth of the bar: from 1e-5 of the rated value to the whole value.
    const double size = std::max(relative, std::abs(shift) / info.rated);
    lines.push_back({info.name, text, size > 1e-5 ? 1 + std::log10(size) / 5 : 0});
  }
  return lines;
}

std::string effect_text(std::string_view kind, const std::string& parameters) {
  return fmt::format("[[effect]]\nkind = \"{}\"\n{}", kind, parameters);
}

// An effect of size zero; an empty list would keep the effects of the preset.
std::string nothing() {
  const std::shared_ptr<Effect> load = make_of(Traits::Family::kLoad);
  std::string zeros;
  for (const FieldRow& row : list_fields([&](FieldVisitor& f) { load->fields(f); }))
    zeros += fmt::format("{} = 0.0\n", row.key);
  return effect_text(load->kind(), zeros);
}

std::string effect_text(const Entry& entry) {
  return entry.setting ? nothing() : effect_text(entry.name, entry.portrait.parameters);
}

std::string drive_text(const Entry& entry) {
  return entry.portrait.drive == Portrait::kReversal ? kReversal : kSteady;
}

// The signal with and without the effect, over the axis of the entry.
Panel signal_panel(const Entry& entry, const Trace& with, const Trace& without) {
  const Portrait& portrait = entry.portrait;
  const SignalInfo& info = kSignals[static_cast<int>(entry.portrait.signal)];
  const auto panel = [&](const Trace& a, const Trace& b, double from, double to,
                         const char* x_label) {
    Panel p{fmt::format("{}, {}", info.meaning, info.unit), x_label, {}, false};
    p.curves.push_back(curve(b, portrait.signal, portrait.over, "without", "#999", from, to));
    p.curves.push_back(curve(a, portrait.signal, portrait.over, "with", "#1f6feb", from, to));
    return p;
  };
  const std::string effect = effect_text(entry);
  if (portrait.over == Portrait::kOverSpeed)
    return panel(run(kRamp, effect), run(kRamp, nothing()), 4.05, 10, "true speed, rad/s");
  if (portrait.over == Portrait::kOverTime)
    return panel(with, without, portrait.from_s, portrait.to_s, "time, s");
  Panel turns = panel(with, without, kSettle, kSettle + 1, "turns");
  if (portrait.switched)
    turns.curves.push_back(curve(
        run(fmt::format("[plant]\ninverter = \"switched\"\n{}", kSteady), effect), portrait.signal,
        portrait.over, "switched inverter", "#d9480f", kSettle, kSettle + 1));
  return turns;
}

Panel spectrum_panel(const Entry& entry, const Trace& with) {
  const SignalInfo& info = kSignals[static_cast<int>(entry.portrait.signal)];
  const Part part =
      part_of(with, static_cast<std::size_t>(entry.portrait.signal), entry.portrait.orders);
  Panel panel{fmt::format("amplitude over mechanical orders, {}", info.unit),
              "periods a turn",
              {{"", "#1f6feb", {}, {}}},
              true};
  Curve& bars = panel.curves[0];
  for (double amplitude : part.spectrum.amplitude) {
    bars.x.push_back(static_cast<double>(bars.x.size() + 1));
    // Less than a millionth of the rated value is nothing.
    bars.y.push_back(amplitude > 1e-6 * info.rated ? amplitude : 0);
  }
  if (*std::max_element(bars.y.begin(), bars.y.end()) == 0)
    panel.empty_note = "none above a millionth of the rated value at constant speed";
  return panel;
}

std::string figure(const Entry& entry, const Trace& without_at_60_rpm) {
  std::vector<std::string> settings;
  if (entry.setting) settings.push_back(entry.setting);
  const std::string drive = drive_text(entry);
  const Trace with = run(drive, effect_text(entry), settings);
  const bool steady = entry.portrait.drive == Portrait::kSteady;
  const Trace without = steady ? without_at_60_rpm : run(drive, nothing());
  return svg(entry.name, {signal_panel(entry, with, without), spectrum_panel(entry, with)},
             fmt::format("where it shows at {} (bar: share of the rated value, five decades)",
                         steady ? "60 rpm and 2 Nm" : "-60 rpm"),
             where_it_shows(with, without, entry.portrait.orders));
}

std::string parameter_table(Effect& effect) {
  std::string text = "| key | unit | range | default | meaning |\n|---|---|---|---|---|\n";
  for (const FieldRow& row : list_fields([&](FieldVisitor& f) { effect.fields(f); })) {
    const std::string range = row.choices.empty() ? fmt::format("{:g} to {:g}", row.lo, row.hi)
                                                  : fmt::format("{}", fmt::join(row.choices, ", "));
    text += fmt::format("| {} | {} | {} | {} | {} |\n", row.key, split_unit(row.key).unit, range,
                        row.required ? "required" : row.value_text, row.meaning);
  }
  return text;
}

std::string page(const Entry& entry) {
  std::string text = fmt::format(
      "# {}\n\n{}.\n\n```\n{}\n```\n\n![{} alone]({}.svg)\n\n**Where it shows.** {}\n\n"
      "**Can be mistaken for.** {}\n\n",
      entry.name, entry.meaning, entry.portrait.equation, entry.name, entry.name,
      entry.portrait.shows, entry.portrait.taken_for);
  if (!entry.setting) text += parameter_table(*make_effect(entry.name)) + "\n";
  const std::string how = entry.setting ? fmt::format("`--set {}`", entry.setting)
                                        : "\n\n```toml\n" + effect_text(entry) + "```";
  const std::string drive = entry.portrait.drive == Portrait::kSteady
                                ? std::string()
                                : fmt::format("\n\nrun by\n\n```toml\n{}```", drive_text(entry));
  return text + "The figure: the niewiara2020 drive without its own effects, with " + how + drive +
         "\n\n[All effects](../effects-gallery.md)\n";
}

void write(const fs::path& path, const std::string& text) {
  std::ofstream out(path);
  out << text;
  if (!out.flush()) throw std::runtime_error(path.string() + ": cannot be written");
}

// `only`: kinds to run again; empty: all. The index is always written.
void make(const fs::path& docs, const std::set<std::string>& only) {
  fs::create_directories(docs / "effects");
  std::string index =
      "# Effects, one by one\n\nEach effect alone on one drive: its shape over a turn, its orders, "
      "and "
      "the signals that show it.\n`tools/effect-gallery` writes the pages. Drive: niewiara2020 "
      "with "
      "exact sensors and its paper's controller,\ncompensation off, 60 rpm against 2 Nm; grey is "
      "the "
      "same without the effect.\n\n"
      "| effect | what it is | equation |\n|---|---|---|\n";
  const Trace without = run(kSteady, nothing());
  for (const Entry& entry : entries()) {
    if (only.empty() || only.contains(entry.name)) {
      std::cout << entry.name << std::endl;
      write(docs / "effects" / fmt::format("{}.svg", entry.name), figure(entry, without));
      write(docs / "effects" / fmt::format("{}.md", entry.name), page(entry));
    }
    std::string equation = entry.portrait.equation;
    for (std::size_t at = 0; (at = equation.find('|', at)) != std::string::npos; at += 2)
      equation.insert(at, "\\");
    index +=
        fmt::format("| [{0}](effects/{0}.md) | {1} | {2} |\n", entry.name, entry.meaning, equation);
  }
  write(docs / "effects-gallery.md", index);
}

}  // namespace
}  // namespace twinrate::gallery

int main(int argc, char** argv) {
  if (argc < 2 || argv[1][0] == '-') {
    std::cerr << "usage: effect_gallery DIR [KIND ...]   (writes DIR/effects-gallery.md and "
                 "DIR/effects/)\n";
    return 2;
  }
  try {
    twinrate::gallery::make(argv[1], {argv + 2, argv + argc});
  } catch (const std::exception& error) {
    std::cerr << error.what() << "\n";
    return 1;
  }
  return 0;
}
