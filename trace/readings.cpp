#include "trace/readings.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "trace/scale_bounds.hpp"
#include "trace/voltage_meaning.hpp"

namespace twinrate {
std::vector<OtherReading> other_readings(int n_p, int encoder_counts) {
  const char* angle = "the mechanical angle, rad";
  std::vector<OtherReading> list;
  const auto add = [&](const char* expected, const char* hint, double factor) {
    list.push_back({"theta_m", expected, hint, {.angle_factor = factor}});
    list.push_back({"theta_m", expected, hint, {.angle_factor = factor, .voltage_stands = true}});
    list.push_back({"theta_m",
                    expected,
                    hint,
                    {.angle_factor = factor, .current_stands = true, .voltage_stands = true}});
  };
  add("an angle that grows with the phases' order a, b, c",
      "direction of the angle reversed, or two phases swapped?", -1);
  add(angle, "degrees?", kDegree);
  add(angle, "turns?", kTwoPi);
  if (n_p > 1) add(angle, "the electrical angle?", 1.0 / n_p);
  if (encoder_counts > 0) add(angle, "counts of the encoder?", kTwoPi / encoder_counts);
  for (const int n : {n_p / 2, 2 * n_p, n_p - 1, n_p + 1, n_p - 2, n_p + 2}) {
    const double factor = static_cast<double>(n) / n_p;
    if (n < 1 || (n == n_p / 2 && 2 * n != n_p)) continue;
    const char* hint = n == n_p / 2   ? "poles in the place of pole pairs?"
                       : n == 2 * n_p ? "half of the pole pairs?"
                                      : "pole pairs miscounted?";
    for (const bool stands : {false, true})
      list.push_back({"n_p",
                      "that of the drive file",
                      hint,
                      {.angle_factor = factor, .voltage_stands = stands},
                      factor * factor});
    list.push_back({"n_p",
                    "that of the drive file",
                    hint,
                    {.angle_factor = factor, .current_stands = true, .voltage_stands = true},
                    factor * factor});
  }
  const char* order = "phases in the order a, b, c";
  const char* swapped[] = {"i_b and i_c swapped?", "i_a and i_b swapped?", "i_a and i_c swapped?"};
  for (int turn = 0; turn < 3; ++turn) {
    const double angle_e = kTwoPi / 3 * turn;
    list.push_back({"i", order, swapped[turn], {.mirrored = true, .current_turn = angle_e}});
    if (turn > 0) list.push_back({"i", order, "phases shifted by one?", {.current_turn = angle_e}});
  }
  for (const double angle_e : {kTwoPi / 4, -kTwoPi / 4})
    list.push_back({"theta_m",
                    "zero where the magnet is on phase a",
                    "its zero turned by 90 degrees electrical?",
                    {.current_turn = angle_e}});
  return list;
}

std::vector<Inconsistency> of_readings(const Record& record, const DriveFacts& facts,
                                       const ScaleFactors& as_it_is, int encoder_counts) {
  // Factor by which the other reading must reduce the error; a frame turned by half a turn has only
  // one sign wrong, so a small factor suffices.
  const double times = turned_by_half(as_it_is) ? 1.2 : 3;
  constexpr double kMuchEmf = 9;  // of the voltage's power: field weakening to a third
  const bool has_voltage = record.has_voltage_equation();
  const bool by_voltage =
      has_voltage && (as_it_is.cell_share < kFrameFails || turned_by_half(as_it_is) ||
                      as_it_is.emf_share > kMuchEmf || beyond(as_it_is).of_machine());
  const bool by_torque =
      as_it_is.torque.cells > 0 && as_it_is.torque_share < (has_voltage ? kFrameFits : kMoves);
  if (!by_voltage && !by_torque) return {};
  struct Best {
    const OtherReading* reading = nullptr;
    double share = 0;
  };
  const auto least = [&](double share) { return std::max(kFrameFits, 1 - (1 - share) / times); };
  Best voltage{.share = least(as_it_is.cell_share)}, torque{.share = least(as_it_is.torque_share)};
  const std::vector<OtherReading> list = other_readings(facts.machine.n_p, encoder_counts);
  for (const OtherReading& other : list) {
    const bool of_current = other.reading.mirrored || other.reading.current_turn != 0;
    const bool same_without_voltage =
        other.K_t_J != 1 || (other.reading.voltage_stands && !other.reading.current_stands);
    if (has_voltage ? !by_voltage && !of_current : same_without_voltage) continue;
    const ScaleFactors f = scales_of(record, facts, other.reading);
    if (!is_this_machine(f, other.K_t_J) || f.voltage_share < as_it_is.voltage_share) continue;
    if (by_voltage && f.cell_share > voltage.share) voltage = {&other, f.cell_share};
    if (by_torque && (of_current || !has_voltage) && f.torque_share > torque.share)
      torque = {&other, f.torque_share};
  }
  const Best& best = torque.reading && !voltage.reading ? torque : voltage;
  if (!best.reading) return {};
  return {{best.reading->quantity, best.reading->expected,
           fmt::format(
               "a rotor frame that explains {:.1f} % of the {}; read the other way {:.1f} %",
               100 * std::max(0.0, &best == &voltage ? as_it_is.cell_share : as_it_is.torque_share),
               &best == &voltage ? "voltage" : "torque", 100 * best.share),
           best.reading->hint}};
}

}  // namespace twinrate
