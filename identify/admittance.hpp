// Sines of voltage at a rotor at rest, and the parameters of the circuit from their response.
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
  double R = 0, L = 0;         // expected values, which set the voltage for the amplitude
};
struct Sine {
  int period = 0;                 // ticks
  std::complex<double> I_over_U;  // A/V, phasors of i_k and of the voltage from t_{k-1} to t_k
  double weight = 1;
  double i = 0;  // A, amplitude; less than wanted if the voltage limit is reached
};
std::vector<Sine> sweep(Experiment& e, const SweepPlan& plan, const std::vector<int>& periods);

struct AxisFit {
  Found L, R;
  double i = 0;       // A, mean amplitude of the sines, weighted as in the fit
  double misfit = 0;  // sum of squares
};
// `gives_way`: the model includes the swing of the rotor (standstill.hpp). Friction disturbs the
// swing at low frequency, so slow sines get a lower weight. Levenberg-Marquardt on
// log(measured/model); the sigmas follow from its residual.
AxisFit fit_axis(std::vector<Sine> sines, double T_s, double R, bool gives_way,
                 const Lateness& late = {});

// Lag of the current readings, from sines that a resistance and an inductance alone fit badly;
// kNone if no lag up to two ticks fits much better.
Lateness find_lateness(const std::vector<Sine>& sines, double T_s, double R);

}  // namespace twinrate
