#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "model/frames.hpp"
#include "report/svg.hpp"
#include "response/response.hpp"

namespace twinrate {
namespace {

using Json = nlohmann::ordered_json;
constexpr double kDegrees = 180 / kPi;
constexpr const char* kColours[] = {"#d62728", "#1f6feb", "#2ca02c", "#9467bd", "#ff7f0e"};

// Phases in degrees, without jumps of a turn.
std::vector<double> unwrapped(const std::vector<std::complex<double>>& H) {
  std::vector<double> phase;
  for (const auto& h : H) {
    const double now = std::arg(h);
    phase.push_back(phase.empty() ? now : phase.back() + wrap_pi(now - phase.back()));
  }
  for (double& p : phase) p *= kDegrees;
  return phase;
}

struct Bode {
  std::vector<double> log_f, dB, phase;
};
Bode bode(const Response& r, bool of_design) {
  Bode b;
  std::vector<std::complex<double>> H;
  for (const ResponseLine& l : r.lines) {
    if (of_design && !l.design) return {};
    if (!of_design && !l.measured()) continue;
    H.push_back(of_design ? *l.design : l.H);
    b.log_f.push_back(std::log10(l.f));
    b.dB.push_back(20 * std::log10(std::abs(H.back())));
  }
  b.phase = unwrapped(H);
  return b;
}

}  // namespace

std::string response_csv(const std::vector<Response>& responses) {
  std::string text =
      "n,f_Hz,gain,phase_deg,coherence,design_gain,design_phase_deg,sigma,measured\n";
  for (const Response& r : responses)
    for (const ResponseLine& l : r.lines)
      text += fmt::format("{},{:.6g},{:.6g},{:.6g},{:.6f},{},{},{:.6g},{}\n", r.n, l.f,
                          std::abs(l.H), std::arg(l.H) * kDegrees, l.coherence,
                          l.design ? fmt::format("{:.6g}", std::abs(*l.design)) : "",
                          l.design ? fmt::format("{:.6g}", std::arg(*l.design) * kDegrees) : "",
                          l.sigma, l.measured() ? 1 : 0);
  return text;
}

std::string response_json(const std::string& drive, const std::vector<Response>& responses) {
  Json list = Json::array();
  // The response to a load rises first, so a bandwidth is not defined.
  const auto bandwidth_json = [](const Response& r, bool of_design) {
    const auto f = bandwidth(r, of_design);
    return f && r.of != ResponseOf::kLoad ? Json(*f) : Json();
  };
  for (const Response& r : responses) {
    Json lines = Json::array();
    for (const ResponseLine& l : r.lines)
      lines.push_back(
          {{"f_Hz", l.f},
           {"gain", std::abs(l.H)},
           {"phase_deg", std::arg(l.H) * kDegrees},
           {"coherence", l.coherence},
           {"sigma", l.sigma},
           {"measured", l.measured()},
           {"design_gain", l.design ? Json(std::abs(*l.design)) : Json()},
           {"design_phase_deg", l.design ? Json(std::arg(*l.design) * kDegrees) : Json()}});
    list.push_back({{"n", r.n},
                    {"locked", r.locked},
                    {"bandwidth_Hz", bandwidth_json(r, false)},
                    {"design_bandwidth_Hz", bandwidth_json(r, true)},
                    {"lines", lines}});
  }
  return Json{{"drive", drive},
              {"response", kResponseNames[static_cast<int>(responses.front().of)]},
              {"runs", list}}
             .dump(2) +
         "\n";
}

std::string response_svg(const std::string& drive, const std::vector<Response>& responses) {
  const char* x_label = "log10 of the frequency in Hz";
  gallery::Panel gain{.title = "gain, dB", .x_label = x_label, .curves = {}};
  gallery::Panel phase{.title = "phase, deg", .x_label = x_label, .curves = {}};
  gallery::Panel coherence{.title = "coherence", .x_label = x_label, .curves = {}};
  bool has_design = false;
  for (std::size_t i = 0; i < responses.size(); ++i) {
    const Response& r = responses[i];
    if (r.lines.empty()) continue;
    if (const Bode d = bode(r, true); !has_design && !d.log_f.empty()) {
      gain.curves.push_back({"design", "#999", d.log_f, d.dB});
      phase.curves.push_back({"design", "#999", d.log_f, d.phase});
      has_design = true;
    }
    const Bode b = bode(r, false);
    const std::string name = fmt::format("n = {}", r.n), colour = kColours[i % 5];
    std::vector<double> log_f, c;
    for (const ResponseLine& l : r.lines) {
      log_f.push_back(std::log10(l.f));
      c.push_back(l.coherence);
    }
    gain.curves.push_back({name, colour, b.log_f, b.dB});
    phase.curves.push_back({name, colour, b.log_f, b.phase});
    coherence.curves.push_back({name, colour, log_f, c});
  }
  return gallery::svg(fmt::format("{}: response of the {} loop", drive,
                                  kResponseNames[static_cast<int>(responses.front().of)]),
                      {gain, phase, coherence}, "", {});
}

}  // namespace twinrate
