#include "export/message_json.hpp"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "import/mcap_format.hpp"

namespace twinrate {

std::string message_schema(const Layout& layout) {
  nlohmann::ordered_json properties = {{"seq", {{"type", "integer"}}}, {"t", {{"type", "number"}}}};
  for (const char* name : mcap::kOriginNames) properties[name] = {{"type", "integer"}};
  for (const Field& f : layout.numbers) {
    const char* type = f.whole ? "integer" : "number";
    properties[f.name] = {{"type", type}};
    if (f.array) properties[f.name] = {{"type", "array"}, {"items", {{"type", type}}}};
  }
  for (const std::string& name : layout.texts) properties[name] = {{"type", "string"}};
  return nlohmann::ordered_json{{"type", "object"}, {"properties", properties}}.dump();
}

std::string message_json(const Layout& layout, const Sample& sample) {
  std::string text =
      fmt::format("{{\"seq\":{},\"t\":{}", sample.k, static_cast<double>(sample.t_ns) / 1e9);
  if (sample.origin.event >= 0)
    text += fmt::format(",\"t_ns\":{},\"session\":{},\"tag\":{},\"timestamp_us\":{}", sample.t_ns,
                        sample.origin.session, sample.origin.tag, sample.origin.timestamp_us);
  const auto number = [](double value) {
    if (value == 0 && std::signbit(value)) return std::string("-0.0");  // -0 is a whole 0
    return std::isfinite(value) ? fmt::format("{}", value) : std::string("null");
  };
  const auto element = [&](const Field& field, std::size_t i) {
    return field.whole ? fmt::format("{}", sample.wholes[i]) : number(sample.numbers[i]);
  };
  std::size_t at = 0;
  for (std::size_t f = 0; f < layout.numbers.size(); at += sample.counts[f++]) {
    const Field& field = layout.numbers[f];
    text += ",\"" + field.name + "\":";
    if (!field.array) {
      text += element(field, at);
      continue;
    }
    text += '[';
    for (std::size_t i = 0; i < sample.counts[f]; ++i)
      text += (i ? "," : "") + element(field, at + i);
    text += ']';
  }
  for (std::size_t f = 0; f < layout.texts.size(); ++f)
    text += ",\"" + layout.texts[f] + "\":" +
            nlohmann::json(sample.texts[f])
                .dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  return text + '}';
}

}  // namespace twinrate
