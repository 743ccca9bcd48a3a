// Hidden motors identified: twenty drives of bench/random_drive, with effects that their
// identification does not know of, and the error of each parameter, its size over its sigma in
// brackets. docs/identify-a-motor.md.
#include <fmt/format.h>

#include <cmath>
#include <iostream>

#include "bench/command_line.hpp"
#include "bench/random_drive.hpp"
#include "core/report_error.hpp"
#include "identify/identify.hpp"
#include "identify/simulated_rig.hpp"
#include "loop/load_drive.hpp"

namespace twinrate::bench {
namespace {

// Every second inverter loses voltage, every third shaft has Coulomb friction, every fourth motor
// saturates, every fifth encoder has another zero; every fourth is wired the wrong way.
std::string hidden_effects(const DriveConfig& d, int index) {
  std::string text;
  const auto& m = d.machine;
  if (index % 2 == 1)
    text += fmt::format(
        "\n[[effect]]\nkind = \"dead_time\"\ndead_time_s = {:.4e}\nlinear_current_A = {:.4e}\n",
        0.01 / d.facts().f_pwm, 0.04 * m.i_rated);
  if (index % 3 == 1)
    text += fmt::format(
        "\n[[effect]]\nkind = \"coulomb_friction\"\ntorque_Nm = {:.4e}\nsmooth_rad_s = {:.4e}\n",
        0.02 * m.T_rated, 1e-3 * m.omega_m_rated);
  if (index % 4 == 2)
    text += fmt::format(
        "\n[[effect]]\nkind = \"saturation\"\ncurrent_q_A = {:.4e}\ncurrent_d_A = {:.4e}\n",
        6 * m.i_rated, 8 * m.i_rated);
  if (index % 5 == 3)
    text +=
        fmt::format("\n[[effect]]\nkind = \"encoder_offset\"\noffset_rad = {:.4e}\n", 0.7 / m.n_p);
  return text;
}

// Percent of the truth.
struct Error {
  double value = 0, sigma = 0;
  std::string text() const {
    return fmt::format("{:+.2f} % ({:.1f})", value, sigma > 0 ? std::abs(value) / sigma : 0);
  }
};
struct Errors {
  Error R_s, L_d, L_q, psi_f, J, friction;
};

Error percent(const Found& found, double truth) {
  return {100 * (found.value / truth - 1), 100 * found.sigma / truth};
}

Errors errors_of(const Identified& f, const MachineParameters& m, double T_coulomb) {
  const double omega = f.omega_m_max;
  const Found friction{f.B.value * omega + f.T_coulomb.value,
                       std::hypot(f.B.sigma * omega, f.T_coulomb.sigma)};
  return {percent(f.R_s, m.R_s), percent(f.L_d, m.L_d),
          percent(f.L_q, m.L_q), percent(f.psi_f, m.psi_f),
          percent(f.J, m.J),     percent(friction, m.B * omega + T_coulomb)};
}

int run(std::uint64_t seed, int first, int count, bool talk) {
  std::cout << "| drive | hidden | n_p | wiring | R_s | L_d | L_q | psi_f | J | friction |\n"
               "|---|---|---|---|---|---|---|---|---|---|\n";
  struct {
    double R_s, L_d, L_q, psi_f, J, friction;
  } worst{};
  int bad = 0;
  for (int i = first; i < first + count; ++i) {
    const RandomDrive drawn = draw_drive(seed, static_cast<std::uint64_t>(i));
    const double theta_e = -2.8 + 0.3 * i;  // the rotor stands anywhere
    Config bare = Config::parse(drawn.text, "drawn");
    try {
      read_all_tables(bare);
    } catch (const BadInput& refused) {  // beyond what a drive file may hold
      std::cout << fmt::format("| {} | not a drive file: {} |\n", i, refused.what());
      ++count;
      continue;
    }
    const std::string effects = hidden_effects(bare.drive(), i);
    Config config = Config::parse(drawn.text + effects, "hidden",
                                  {fmt::format("plant.theta_e_start_rad={:.3f}", theta_e)});
    read_all_tables(config);
    const MachineParameters& m = config.drive().machine;
    const bool swapped = i % 4 == 3;
    std::string names;
    for (const auto& e : config.drive().effects)
      names += (names.empty() ? "" : ", ") + std::string(e.effect->kind());
    if (talk) std::cerr << drawn.text;
    try {
      SimulatedRig rig(config, {swapped, false});
      const Identified f = identify(rig, limits_of(bare.drive()),
                                    {[talk](const std::string& what, double) {
                                       if (talk) std::cerr << what << "\n";
                                     },
                                     {}});
      const Errors e = errors_of(f, m, i % 3 == 1 ? 0.02 * m.T_rated : 0);
      const bool right = f.n_p == m.n_p && f.mirrored == swapped;
      if (!right) ++bad;
      std::cout << fmt::format(
          "| {} | {} | {} | {} | {} | {} | {} | {} | {} | {} |\n", i, names.empty() ? "-" : names,
          f.n_p, right ? (swapped ? "swapped, found" : "right") : "WRONG", e.R_s.text(),
          e.L_d.text(), e.L_q.text(), e.psi_f.text(), e.J.text(), e.friction.text());
      const auto grow = [](double& most, const Error& x) {
        most = std::max(most, std::abs(x.value));
      };
      grow(worst.R_s, e.R_s), grow(worst.L_d, e.L_d), grow(worst.L_q, e.L_q);
      grow(worst.psi_f, e.psi_f), grow(worst.J, e.J), grow(worst.friction, e.friction);
      if (talk) std::cout << drawn.machine << "\n" << identified_text(f, compare(f, m));
    } catch (const BadInput& refused) {
      std::cout << fmt::format("| {} | not a drive file: {} |\n", i, refused.what());
      ++count;
    } catch (const RunFailed& failed) {
      ++bad;
      std::cout << fmt::format("| {} | {} | failed: {} |\n", i, names, failed.what());
    }
    std::cout << std::flush;
  }
  std::cout << fmt::format(
      "| largest | | | | {:.2f} % | {:.2f} % | {:.2f} % | {:.2f} % | {:.2f} % | {:.2f} % |\n",
      worst.R_s, worst.L_d, worst.L_q, worst.psi_f, worst.J, worst.friction);
  return bad == 0 ? 0 : 1;
}

}  // namespace
}  // namespace twinrate::bench

int main(int argc, char** argv) try {
  twinrate::bench::CommandLine command_line{"Identify hidden motors, print the table of errors"};
  std::uint64_t seed = 1;
  int first = 0, count = 20;
  bool talk = false;
  command_line.option("--seed", &seed, "draw with this seed");
  command_line.option("--first", &first, "begin with this drive");
  command_line.option("--count", &count, "identify so many drives");
  command_line.flag("--text", talk, "print the text of each");
  if (const auto status = command_line.parse(argc, argv)) return *status;
  return twinrate::bench::run(seed, first, count, talk);
} catch (...) {
  return twinrate::report_error("identify_hidden");
}
