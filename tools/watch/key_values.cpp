#include "tools/watch/key_values.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "core/decode.hpp"
#include "core/field_list.hpp"
#include "core/reason.hpp"
#include "model/signals.hpp"

namespace twinrate {
namespace {

std::string mode_text(int mode) {
  constexpr const char* kNames[] = {"run", "align", "I/f ramp", "safe"};
  return mode >= 0 && mode < 4 ? kNames[mode] : fmt::format("mode {}", mode);
}

std::string status_text(int status) {
  constexpr std::pair<int, const char*> kBits[] = {{kBeforeFirstGain, "before first gain"},
                                                   {kLateGain, "late gain"},
                                                   {kGapBridged, "gap bridged"},
                                                   {kNotFinite, "not finite"},
                                                   {kNoVoltage, "no voltage"},
                                                   {kAngleForced, "angle forced"},
                                                   {kGainEveryTick, "gain every tick"}};
  std::string text;
  for (const auto& [bit, name] : kBits)
    if (status & bit) text += (text.empty() ? "" : ", ") + std::string(name);
  return text;
}

std::string reason_text(int reason) {
  for (const ReasonText& known : kReasons)
    if (static_cast<int>(known.reason) == reason) return known.name;
  return fmt::format("reason {}", reason);
}

KeyValues show(const measurement_t& m) {
  return {{{"theta_m_rad", m.theta_m_rad},
           {"omega_m_rad_s", m.omega_m_rad_s},
           {"i_a_A", m.i_a_A},
           {"i_b_A", m.i_b_A},
           {"i_c_A", m.i_c_A},
           {"u_alpha_V", m.u_alpha_V},
           {"u_beta_V", m.u_beta_V},
           {"v_dc_V", m.v_dc_V}},
          mode_text(m.mode)};
}
KeyValues show(const truth_t& t) {
  return {{{"theta_m_rad", t.theta_m_rad},
           {"omega_m_rad_s", t.omega_m_rad_s},
           {"i_d_A", t.i_d_A},
           {"i_q_A", t.i_q_A},
           {"T_em_Nm", t.T_em_Nm},
           {"T_load_Nm", t.T_load_Nm}},
          ""};
}
KeyValues show(const estimate_t& e) {
  return {{{"theta_e_rad", e.theta_e_rad},
           {"omega_m_rad_s", e.omega_m_rad_s},
           {"i_d_A", e.i_d_A},
           {"i_q_A", e.i_q_A},
           {"T_load_Nm", e.T_load_Nm}},
          status_text(e.status)};
}
KeyValues show(const gain_t& g) {
  KeyValues values{{{"first_use_seq", static_cast<double>(g.first_use_seq)}}, ""};
  if (!g.P.empty()) values.numbers.push_back({"P_last_state", g.P.back()});
  return values;
}
KeyValues show(const reference_t& r) {
  return {{{"omega_m_ref_rad_s", r.omega_m_ref_rad_s}, {"i_d_ref_A", r.i_d_ref_A}}, ""};
}
KeyValues show(const command_t& c) {
  return {{{"omega_m_ref_rad_s", c.omega_m_ref_rad_s},
           {"i_d_ref_A", c.i_d_ref_A},
           {"i_q_ref_A", c.i_q_ref_A},
           {"u_alpha_V", c.u_alpha_V},
           {"u_beta_V", c.u_beta_V}},
          mode_text(c.mode)};
}
KeyValues show(const event_t& e) {
  return {{}, reason_text(e.reason) + ": " + e.text};
}
KeyValues show(const manifest_t& m) {
  return {{{"schema", static_cast<double>(m.schema)}}, "revision " + m.revision};
}
KeyValues show(const request_t& r) {
  constexpr const char* kKinds[] = {"", "start", "stop", "emergency stop"};
  const bool known = r.kind >= 1 && r.kind <= 3;
  return {{{"value", r.value}}, known ? kKinds[r.kind] : fmt::format("kind {}", r.kind)};
}
KeyValues show(const reply_t& r) {
  return {{{"applied_seq", static_cast<double>(r.applied_seq)}},
          r.accepted ? "applied" : "refused: " + r.text};
}
KeyValues show(const ack_t& a) {
  return {{{"missing", static_cast<double>(a.n_missing)}}, ""};
}
// Shown in the table of processes.
KeyValues show(const status_t&) {
  return {};
}

template <class Message>
KeyValues decode_and_show(const std::vector<std::uint8_t>& bytes) {
  Message message{};
  if (!decode(message, bytes.data(), bytes.size()))
    return {{}, "another message layout than this program's", false};
  return show(message);
}

}  // namespace

KeyValues key_values(Channel channel, const std::vector<std::uint8_t>& bytes) {
  switch (channel) {
    case Channel::kMeasurement:
      return decode_and_show<measurement_t>(bytes);
    case Channel::kTruth:
      return decode_and_show<truth_t>(bytes);
    case Channel::kEstimate:
      return decode_and_show<estimate_t>(bytes);
    case Channel::kGain:
      return decode_and_show<gain_t>(bytes);
    case Channel::kReference:
      return decode_and_show<reference_t>(bytes);
    case Channel::kCommand:
      return decode_and_show<command_t>(bytes);
    case Channel::kStatus:
      return decode_and_show<status_t>(bytes);
    case Channel::kEvent:
      return decode_and_show<event_t>(bytes);
    case Channel::kManifest:
      return decode_and_show<manifest_t>(bytes);
    case Channel::kRequest:
      return decode_and_show<request_t>(bytes);
    case Channel::kReply:
      return decode_and_show<reply_t>(bytes);
    case Channel::kAck:
      return decode_and_show<ack_t>(bytes);
  }
  return {};
}

std::string to_text(const KeyValues& values) {
  std::string text;
  for (const auto& [key, value] : values.numbers) {
    const NameAndUnit split = split_unit(key);
    std::string unit = split.unit == "1" ? "" : " " + split.unit;
    if (unit == " rad_s") unit = " rad/s";
    const bool whole = value == std::round(value) && std::abs(value) < 1e15;
    text += fmt::format("{}{} {}{}", text.empty() ? "" : "  ", split.name,
                        whole ? fmt::format("{:.0f}", value) : fmt::format("{:.4g}", value), unit);
  }
  if (!values.text.empty()) text += (text.empty() ? "" : "  ") + values.text;
  return text;
}

}  // namespace twinrate
