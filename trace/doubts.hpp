// The reasons why a result says less than its fit: the residual, the rows or another candidate
// leaves a doubt. A function that takes the result changes its verdict to `ambiguous`, and its
// sentence to the reason.
#pragma once
#include <string>
#include <vector>

#include "trace/fit.hpp"
#include "trace/result.hpp"
#include "trace/selection.hpp"

namespace twinrate {

inline constexpr const char* kLongerRun =
    "Record a longer run with several speeds in both directions, load and i_d "
    "(twinrate trace --plan proposes one).";

// "Nothing missing" needs a record that can show enough kinds, a residual at the noise floor, and
// no structure that the judging rows leave unconfirmed.
void doubt_nothing(const Fitter& fitter, const Fit& fit, const std::string& unconfirmed,
                   TraceResult& r);
// An effect from the samples lowers no error. Beside it the model must meet the conditions of
// "nothing missing" and predict better than no change.
void doubt_samples_alone(const Fitter& fitter, const Fit& fit, TraceResult& r);
// A candidate with a large score that was refused, by its refinement or by held-out rows, is a
// structure without a name: a claim may be a part of it. Only of effects with linear columns: the
// score of the others before their refinement is a guess.
void doubt_unconfirmed(const std::vector<Alternative>& refused, TraceResult& r);

// `refused`: by the gate, in a trace with the voltage, which `r` leaves out. A refused claim that
// lowers the error and can act on the torque may be the cause of what `r` names.
void doubt_beside_refused(const std::vector<Refused>& refused, TraceResult& r);

// True if half of the rows have the same speed to 5 %. The rounding of an angle repeats there.
bool at_constant_speed(const Equations& equations);
// Of each output: whether the speed changes within 0.1 s of it.
std::vector<char> changing_speed(const Equations& equations, const Runs& outputs);
// The reason why a torque in time may be an error of the sensors, empty if there is none. At constant
// speed, the rounding of an angle or a current repeats after equal times. `i_lsb`: step of the
// currents, A.
std::string doubt_of_line(const Effect& line, const Chain& chain, double i_lsb);

}  // namespace twinrate
