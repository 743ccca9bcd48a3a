#include "bench/blind/drawn_case.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "bench/blind/drawn_effects.hpp"

namespace twinrate::blind {
namespace {

struct Steps {
  std::vector<ProfileStep> speed, load = {{0, 0}}, i_d = {{0, 0}};
};

// Speeds from `lo` to `hi` of rated speed; `both`: of both signs.
void varied(Draw& d, DrawnCase& c, Steps& s, double lo, double hi, bool both) {
  const MachineParameters& m = c.drawn.machine;
  const double direction = d.either(-1, 1);
  for (double t = 0; t < c.duration_s;) {
    const double span = d.between(0.4, 1.2);
    const double turn = both ? d.either(-1, 1) : direction;
    const double speed = turn * d.log_between(lo, hi) * m.omega_m_rated;
    s.speed.push_back({t, speed});
    if (c.with_load) s.load.push_back({t + 0.5 * span, 0});
    if (c.with_load && d.happens(0.6))
      s.load.back().value = std::copysign(d.between(0.1, 0.6) * m.T_rated, speed);
    if (both && c.mode != "angle_current" && d.happens(0.5)) {
      s.i_d.push_back({t + 0.6 * span, d.signed_between(0.1, 0.4) * m.i_rated});
      s.i_d.push_back({t + 0.9 * span, 0});
    }
    t += span;
  }
}

void moves(Draw& d, DrawnCase& c, Steps& s) {
  const double move = d.between(0.25, 0.7), pause = d.between(0.1, 0.3);
  double speed = d.between(0.15, 0.6) * c.drawn.machine.omega_m_rated;
  for (double t = 0; t < c.duration_s; t += move + pause, speed = -speed) {
    s.speed.push_back({t, speed});
    s.speed.push_back({t + move, 0});
  }
}

void draw_profile(Draw& d, DrawnCase& c) {
  const double omega = c.drawn.machine.omega_m_rated;
  const double one_speed = d.signed_between(0.2, 0.85) * omega;
  c.slew_rad_s2 = omega / (c.drawn.t_accelerate * d.between(1.2, 3));
  // A log of angle and i_q does not hold a load or an i_d.
  const bool logged = c.mode != "angle_current";
  c.with_load = logged && (c.profile == "rich" || (c.profile == "one_direction" && d.happens(0.5)));
  Steps s;
  if (c.profile == "rich") varied(d, c, s, 0.05, 0.85, true);
  if (c.profile == "slow") varied(d, c, s, 0.02, 0.06, false);
  if (c.profile == "one_direction") varied(d, c, s, 0.1, 0.85, false);
  if (c.profile == "one_start") s.speed = {{0, 0}, {0.3, one_speed}};
  if (c.profile == "p2p") moves(d, c, s);
  if (c.profile == "steady") s.speed = {{0, one_speed}};
  c.speed_rad_s = Profile(s.speed), c.load_Nm = Profile(s.load), c.i_d_A = Profile(s.i_d);
}

void draw_mode(Draw& d, DrawnCase& c) {
  constexpr std::array kRates = {2000.0, 1000.0, 500.0, 200.0};
  const double rate = kRates[static_cast<std::size_t>(d.whole(0, 3))];
  const double share = d.between(0, 1);
  c.mode = share < 0.4    ? "full"
           : share < 0.7  ? "decimated"
           : share < 0.88 ? "angle_current"
                          : "novolt";
  const bool slower = c.mode == "novolt" ? d.happens(0.5) : c.mode != "full";
  c.every = slower ? static_cast<int>(std::lround(c.drawn.f_s / rate)) : 1;
  c.mean_voltage = d.happens(0.5) && c.every > 1;
}

// One shaft a drive, and no kind twice.
void draw_effects(Draw& d, DrawnCase& c, int count) {
  const std::vector<std::string> kinds = kinds_for(c.every == 1);
  const auto has = [&](const char* kind) {
    return std::count(c.kinds.begin(), c.kinds.end(), kind);
  };
  while (static_cast<int>(c.kinds.size()) < count) {
    const auto& kind =
        kinds[static_cast<std::size_t>(d.whole(0, static_cast<int>(kinds.size()) - 1))];
    const bool second_shaft =
        (kind == "torsion" && has("backlash")) || (kind == "backlash" && has("torsion"));
    if (!has(kind.c_str()) && !second_shaft) c.kinds.push_back(kind);
  }
  const DrawnLogFacts facts{c.drawn, c.drawn.f_s / c.every, c.duration_s};
  for (const std::string& kind : c.kinds) {
    c.effect_tables.push_back(draw_effect(kind, d, facts));
    c.effects_toml += c.effect_tables.back();
  }
}

std::string profile_toml(const Profile& profile) {
  std::string text;
  for (const ProfileStep& s : profile.steps())
    text += fmt::format("{}[{:.6g}, {:.8g}]", text.empty() ? "" : ", ", s.t_s, s.value);
  return "[" + text + "]";
}

}  // namespace

DrawnCase draw_case(std::uint64_t seed, int attempt) {
  DrawnCase c;
  c.seed = seed, c.attempt = attempt, c.name = fmt::format("drawn{}", seed);
  Draw d(seed * 104729 + 11 + 1000003 * static_cast<std::uint64_t>(attempt));
  c.drawn = draw_machine(d);
  const double share = d.between(0, 1);
  static const char* const kOthers[] = {"slow", "one_direction", "one_start", "p2p", "steady"};
  const int other = d.whole(0, 4);
  c.profile = share < 0.4 ? "rich" : kOthers[other];
  draw_mode(d, c);
  draw_profile(d, c);
  const int count = d.whole(1, 3);
  draw_effects(d, c, seed % 2 ? count : 0);
  return c;
}

double load_slew(const DrawnCase& c) {
  return 20 * c.drawn.machine.T_rated;
}

std::string plant_toml(const DrawnCase& c) {
  std::string text = drive_toml(c.drawn, c.name, c.drawn.encoder_counts);
  const double omega_e = c.drawn.machine.n_p * c.speed_rad_s.at(0);
  text.erase(text.find("\n[reference]"));
  text += fmt::format("\n[reference]\nomega_e_rad_s = {:.10g}\n", omega_e);
  text += fmt::format("\n[load]\nT_load_Nm = {}\nslew_Nm_s = {:.6g}\n", profile_toml(c.load_Nm),
                      c.hidden.torque_Nm ? 1e6 : load_slew(c));
  text += fmt::format("\n[run]\nduration_s = {}\nsettle_s = 1\nseed = {}\n", c.duration_s,
                      c.seed % 1000000007);
  if (c.profile == "steady") text.insert(text.find("\n[machine]"), "start = \"flying\"\n");
  return text + c.effects_toml;
}

}  // namespace twinrate::blind
