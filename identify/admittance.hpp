// Sines of voltage on a rotor at rest, and the circuit behind them.
#pragma once
#include <complex>
#include <vector>

#include "identify/experiment.hpp"
#include "identify/found.hpp"

namespace twinrate {

struct SweepPlan {
  Vec2 u_hold = Vec2::Zero();  // V, holds the rotor
  Vec2 axis = Vec2::Zero();    // unit vector of the sine
  double i = 0;                // A, wanted amplitude
  double R = 0, L = 0;         // expected, for the amplitude
};
struct Sine {
  int period = 0;                 // ticks
  std::complex<double> I_over_U;  // A/V, phasors of i_k and of the voltage from t_{k-1} to t_k
  double weight = 1;
  double i = 0;  // A, amplitude; less than wanted where the voltage ends
};
std::vector<Sine> sweep(Experiment& e, const SweepPlan& plan, const std::vector<int>& periods);

struct AxisFit {
  Found L, R;
  double i = 0;       // A, mean amplitude of the sines, weighted as in the fit
  double misfit = 0;  // sum of squares
};
// `gives_way`: with the swing of the rotor (standstill.hpp), which its friction spoils at low
// frequency: slow sines count less. Levenberg-Marquardt on
// log(measured/model); the sigmas are those of the residual.
AxisFit fit_axis(std::vector<Sine> sines, double T_s, double R, bool gives_way,
                 const Lateness& late = {});

// How late the current is read, of sines that a resistance and an inductance fit badly; none where
// no lag up to two ticks fits much better.
Lateness find_lateness(const std::vector<Sine>& sines, double T_s, double R);

}  // namespace twinrate
