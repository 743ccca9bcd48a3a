#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "identify/identify.hpp"
#include "loop/load_drive.hpp"

namespace twinrate {
namespace {

using Json = nlohmann::ordered_json;
constexpr const char* kLatenessForms[] = {"none", "delay", "first_order"};
constexpr double kAngleMaterial = 2e-3;  // electrical, rad: a smaller zero is not written

// The mechanical reading at which the d axis is phase a, nearest to zero, for an encoder that
// counts with the phase order. A reading is the lower end of an encoder step.
double encoder_offset(const Identified& f, int encoder_counts) {
  const double half_step = encoder_counts > 0 ? kPi / encoder_counts : 0;
  return wrap_pi(f.n_p * (f.theta_zero + half_step)) / f.n_p;
}

std::string saturation_table(const Identified& f) {
  if (!f.saturation_d && !f.saturation_q) return "";
  const int form = f.saturation_q ? f.saturation_q->form : f.saturation_d->form;
  std::string text = fmt::format(
      "\n[[effect]]\nkind = \"saturation\"\nused_in = \"both\"\nform = \"{}\"\n"
      "current_q_A = {:.6g}\n",
      kSaturationForms[form], f.saturation_q ? f.saturation_q->I_s : 0.0);
  if (f.saturation_d) text += fmt::format("current_d_A = {:.6g}\n", f.saturation_d->I_s);
  return text;
}

std::string effects_text(const Identified& f, int encoder_counts) {
  std::string text = saturation_table(f);
  if (f.loss.V.value != 0)
    text += fmt::format(
        "\n[[effect]]\nkind = \"inverter_drop\"\nused_in = \"both\"\nthreshold_V = {:.6g}\n"
        "linear_current_A = {:.6g}\nshape = \"{}\"\n",
        f.loss.V.value, f.loss.i_linear, kCurrentShapeNames[static_cast<int>(f.loss.shape)]);
  if (f.T_coulomb.value != 0)
    text += fmt::format(
        "\n[[effect]]\nkind = \"coulomb_friction\"\nused_in = \"both\"\ntorque_Nm = {:.6g}\n",
        f.T_coulomb.value);
  if (f.T_constant.value != 0)
    text += fmt::format(
        "\n[[effect]]\nkind = \"constant_load\"\nused_in = \"both\"\ntorque_Nm = {:.6g}\n",
        f.T_constant.value);
  if (f.fan.value != 0)
    text += fmt::format(
        "\n[[effect]]\nkind = \"fan_load\"\nused_in = \"both\"\ncoefficient_Nms2 = {:.6g}\n",
        f.fan.value);
  const double offset = encoder_offset(f, encoder_counts);
  const bool has_offset = std::abs(offset) * f.n_p > kAngleMaterial;
  if (f.T_sin.value != 0)  // over the angle of the machine instead of the encoder
    text += fmt::format(
        "\n[[effect]]\nkind = \"eccentric_load\"\nused_in = \"both\"\namplitude_Nm = {:.6g}\n"
        "phase_rad = {:.6g}\n",
        std::hypot(f.T_sin.value, f.T_cos.value),
        wrap_pi(std::atan2(f.T_cos.value, f.T_sin.value) + (has_offset ? offset : 0)));
  if (has_offset)
    text += fmt::format(
        "\n[[effect]]\nkind = \"encoder_offset\"\nused_in = \"both\"\noffset_rad = {:.6g}\n",
        offset);
  return text;
}

std::string percent(const Found& f) {
  if (f.sigma == 0 || f.value == 0) return "";
  return fmt::format("{:.2g} %", 100 * f.sigma / std::abs(f.value));
}

std::vector<std::string> further(const Identified& f) {
  std::vector<std::string> lines;
  if (f.loss.V.value != 0)
    lines.push_back(fmt::format("inverter loses    {:.3g} V a phase above {:.3g} A, shape {}",
                                f.loss.V.value, f.loss.i_linear,
                                kCurrentShapeNames[static_cast<int>(f.loss.shape)]));
  if (f.T_coulomb.value != 0)
    lines.push_back(fmt::format("Coulomb friction  {:.4g} Nm, sigma {}", f.T_coulomb.value,
                                percent(f.T_coulomb)));
  if (f.T_constant.value != 0)
    lines.push_back(fmt::format("constant torque   {:.4g} Nm, sigma {}", f.T_constant.value,
                                percent(f.T_constant)));
  if (f.fan.value != 0)
    lines.push_back(
        fmt::format("fan torque        {:.4g} Nms2 times the square of the speed, sigma {}",
                    f.fan.value, percent(f.fan)));
  const auto saturation = [&](const char* axis, const std::optional<SaturationFound>& s) {
    if (s)
      lines.push_back(fmt::format("saturation along {} {}, I_s = {:.4g} A", axis,
                                  kSaturationForms[s->form], s->I_s));
  };
  saturation("d", f.saturation_d);
  saturation("q", f.saturation_q);
  return lines;
}

Json points_json(const std::vector<InductancePoint>& points) {
  Json list = Json::array();
  for (const InductancePoint& p : points)
    list.push_back({{"i_A", p.i},
                    {"L_H", p.L.value},
                    {"sigma_H", p.L.sigma},
                    {"of", p.small ? "small changes" : "flux over current"}});
  return list;
}

}  // namespace

std::string identified_toml(const Config& drive, const Identified& f) {
  std::vector<std::string> overrides = {fmt::format("machine.n_p={}", f.n_p)};
  std::string kept;
  const auto set = [&](const char* key, const Found& found, bool known) {
    if (known && found.value >= 0)
      overrides.push_back(fmt::format("machine.{}={:.6e}", key, found.value));
    else
      kept += (kept.empty() ? "" : ", ") + std::string(key);
  };
  set("R_s_Ohm", f.R_s, f.R_s.is_known());
  set("L_d_H", f.L_d, f.L_d.is_known());
  set("L_q_H", f.L_q, f.L_q.is_known());
  set("psi_f_Wb", f.psi_f, f.psi_f.is_known());
  set("J_kgm2", f.J, f.J.is_known());
  set("B_Nms", f.B, f.J.is_known());
  const std::string text =
      drive.resolved_with({}) + effects_text(f, drive.drive().sensors.encoder_counts);
  Config config = Config::parse(text, "identified.toml", overrides);
  read_all_tables(config);
  std::string head = "# Machine and effects identified by twinrate identify.\n";
  if (!kept.empty())
    head += "# Not identified, the value is that of the source file: " + kept + ".\n";
  if (f.mirrored)
    head +=
        "# The encoder counted against the phase order: this file is right once the encoder is "
        "negated.\n";
  return head + config.resolved();
}

std::string identified_json(const Identified& f, const std::vector<SheetRow>& rows) {
  Json parameters = Json::object();
  for (const SheetRow& row : rows)
    parameters[row.key] = {{"value", row.found.value},
                           {"sigma", row.found.sigma},
                           {"unit", row.unit},
                           {"sheet", row.sheet},
                           {"verdict", row.verdict}};
  const auto found = [](const Found& x, const char* unit) {
    return Json{{"value", x.value}, {"sigma", x.sigma}, {"unit", unit}};
  };
  const auto saturation = [](const std::optional<SaturationFound>& s) {
    return s ? Json{{"form", kSaturationForms[s->form]}, {"I_s_A", s->I_s}} : Json();
  };
  const Json json = {
      {"parameters", parameters},
      {"encoder_against_phase_order", f.mirrored},
      {"encoder_zero_rad", f.theta_zero},
      {"current_offset_A", {f.i_offset[0], f.i_offset[1], f.i_offset[2]}},
      {"coulomb_friction", found(f.T_coulomb, "Nm")},
      {"constant_torque", found(f.T_constant, "Nm")},
      {"fan_load", found(f.fan, "Nms2")},
      {"inverter_loss",
       {{"threshold", found(f.loss.V, "V")},
        {"linear_current_A", f.loss.i_linear},
        {"shape", kCurrentShapeNames[static_cast<int>(f.loss.shape)]}}},
      {"torque_once_a_turn", {{"sin", found(f.T_sin, "Nm")}, {"cos", found(f.T_cos, "Nm")}}},
      {"stale_share", f.stale_share},
      {"current_lag",
       {{"form", kLatenessForms[f.current.form]}, {"lag", found(f.current.lag, "s")}}},
      {"angle_lag", found(f.angle_lag, "s")},
      {"saturation_d", saturation(f.saturation_d)},
      {"saturation_q", saturation(f.saturation_q)},
      {"L_d_over_current", points_json(f.L_d_points)},
      {"L_q_over_current", points_json(f.L_q_points)},
      {"test_current_A", f.i_max},
      {"top_speed_rad_s", f.omega_m_max},
      {"duration_s", f.duration},
      {"not_identified", f.notes}};
  return json.dump(2) + "\n";
}

std::string identified_text(const Identified& f, const std::vector<SheetRow>& rows) {
  std::string text =
      fmt::format("  {:<6} {:>13} {:<5} {:>8}   {:>10}\n", "", "identified", "", "sigma", "sheet");
  for (const SheetRow& row : rows)
    text += fmt::format("  {:<6} {:>13} {:<5} {:>8}   {:>10}   {}\n", row.key,
                        fmt::format("{:.4g}", row.found.value), row.unit, percent(row.found),
                        fmt::format("{:.4g}", row.sheet), row.verdict);
  for (const std::string& line : further(f)) text += "  " + line + "\n";
  text += fmt::format("  {:.3g} s of experiments, up to {:.3g} A and {:.4g} rpm\n", f.duration,
                      f.i_max, f.omega_m_max * 60 / kTwoPi);
  if (f.mirrored)
    text +=
        "  the encoder counts against the phase order: negate it, or swap two phases and identify "
        "again\n";
  text += "not identified\n";
  for (const std::string& note : f.notes) text += "  " + note + "\n";
  return text;
}

}  // namespace twinrate
