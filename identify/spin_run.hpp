// The runs of the turning motor: ramps between the ends of the speed range, and coasts.
#pragma once
#include <vector>

#include "identify/experiment.hpp"
#include "identify/found.hpp"

namespace twinrate {

inline constexpr double kLevels[] = {0.25, 0.5, 0.75, 1};  // of i_max
inline constexpr int kLevelCount = 4;
inline constexpr std::size_t kLeastRows = 60;  // of a piece

// Currents and voltages within a tick that the samples at its ends do not show.
struct Tick {
  Vec2 bow = Vec2::Zero();   // A, mean current less the mean of its two ends
  double bow_q = 0;          // A, mean i_q less the mean of its two ends
  Vec2 drop = Vec2::Zero();  // V, mean loss of the inverter
};

struct SpinRun {
  Rows rows;
  std::vector<Tick> ticks = {};  // of the tick before each row; empty until psi_f is known
  int level = -1;                // of kLevels; -1: coast, slow ramp
};

// Runs the ramps and coasts. Fills found.omega_m_max. Throws RunFailed: the shaft does not turn.
std::vector<SpinRun> run_spin(Experiment& e, Identified& found);

// d theta/dt about row k.
double speed_about(const Rows& rows, std::size_t k, double T_s);

}  // namespace twinrate
