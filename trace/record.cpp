#include "trace/record.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace twinrate {
namespace {

constexpr std::size_t kSeam = 12;  // rows at a seam whose speed would mix both records
constexpr int kApart = 24;         // rows between two records, so that the times show the seam

template <class T>
void add(std::vector<T>& a, const std::vector<T>& b) {
  a.insert(a.end(), b.begin(), b.end());
}

}  // namespace

double length_of_mean(double turn_e, double ticks) {
  const double half = 0.5 * turn_e, half_tick = half / ticks;
  return std::abs(half_tick) < 1e-6 ? 1 : std::sin(half) / (ticks * std::sin(half_tick));
}

void Record::append(const Record& other) {
  if (t.empty()) {
    *this = other;
    return;
  }
  const auto need = [&](bool here, bool there, const char* what) {
    if (here != there)
      throw std::runtime_error((there ? source : other.source) + ": no " + what + ", which " +
                               (there ? other.source : source) +
                               " has; all logs need the same signals, or trace each for itself");
  };
  need(!u_alphabeta.empty(), !other.u_alphabeta.empty(), "voltage");
  need(!i_alphabeta.empty(), !other.i_alphabeta.empty(), "current");
  need(!v_dc.empty(), !other.v_dc.empty(), "v_dc");
  need(!T_load.empty(), !other.T_load.empty(), "T_load");
  need(load_measured, other.load_measured, "measured torque");
  if (current_sensors != other.current_sensors)
    throw std::runtime_error(other.source + ": " + std::to_string(other.current_sensors) +
                             " currents measured, in " + source + " " +
                             std::to_string(current_sensors) +
                             "; all logs need the same signals, or trace each for itself");
  if (std::abs(other.T_s / T_s - 1) > 0.01)
    throw std::runtime_error(other.source + ": sampled every " + std::to_string(other.T_s) +
                             " s, " + source + " every " + std::to_string(T_s) +
                             " s; all logs need the same rate, or trace each for itself");
  i_q_alone |= other.i_q_alone;
  ticks_each = std::max(ticks_each, other.ticks_each);
  if (other.angle.lsb > angle.lsb) angle = other.angle;
  const std::size_t seam = size();
  const bool goes_on = other.t.front() > t.back() + 0.5 * T_s;
  const double later = goes_on ? 0 : t.back() + kApart * T_s - other.t.front();
  for (double time : other.t) t.push_back(time + later);
  add(u_alphabeta, other.u_alphabeta);
  add(i_alphabeta, other.i_alphabeta);
  add(theta_m, other.theta_m);
  add(v_dc, other.v_dc);
  add(T_load, other.T_load);
  add(electrical_ok, other.electrical_ok);
  add(motion_ok, other.motion_ok);
  for (std::size_t k = seam - std::min(seam, kSeam); k < std::min(size(), seam + kSeam); ++k)
    electrical_ok[k] = motion_ok[k] = 0;
}

}  // namespace twinrate
