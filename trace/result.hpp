// What a trace says: the contract's trace.json, and what the report page draws.
#pragma once
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "model/effects/effect.hpp"

namespace twinrate {

struct TracedParameter {
  std::string name, unit;  // the key of the [[effect]] table without and with its unit
  double value = 0;
  std::optional<double> sigma;  // one standard deviation; none where it was not fitted
  std::string text;             // name of a choice, instead of a value
};

// What one effect does in one channel, row by row of that channel's TraceSeries (V, Nm).
struct EffectView {
  std::string channel;          // d, q, torque
  std::vector<double> without;  // residual of the model that has all the others
  std::vector<double> share;    // what this effect takes off it
};

struct TracedEffect {
  std::shared_ptr<const Effect> effect;
  std::string equation;  // electrical, mechanical, sensing
  std::vector<TracedParameter> parameters;
  double held_out_gain = 0;          // share of the held-out error that goes with it
  double delta_bic = 0;              // of the training score, negative: better
  double p_value = 1;                // F-test
  double materiality = 0;            // size over the smallest worth reporting
  std::vector<std::string> aliases;  // kinds that explain the same as well
  bool only_in_log = false;          // spoils what is logged, not what the drive runs on
  // Of a part of the record (trace/change_points.hpp): when it begins and ends, where that is inside
  // a file, and the files of the part.
  bool only_in_part = false;
  std::optional<double> from_s, to_s;
  std::vector<std::string> files;
  bool from_samples = false;      // found in the raw samples (clipping, missing rows), not fitted
  std::vector<EffectView> views;  // for the pictures: the channels that it shows in
};

// A kind that was considered and why it is not among the effects.
struct Rejected {
  std::string kind;
  double score_gain = 0, held_out_gain = 0;
  std::string why;
};

struct Ambiguity {
  std::vector<std::string> kinds;
  std::string why, would_separate;
};

// What of the log and the drive file do not belong together: a unit, a scale, another machine.
struct Inconsistency {
  std::string quantity;         // a column, or a parameter of the machine
  std::string expected, found;  // ranges in words, with units
  std::string hint;             // what it may be, as a question
};

// A claim that did not pass the gate (trace/gate.hpp).
struct Refused {
  std::string kind;
  std::string rule;         // sensors, transfer, agreement, alone, size, physical, whole
  std::string file;         // where it failed; empty: on all of them together
  double number = 0;        // of the rule
  bool left = false;        // it lowers the error of rows that judge: something is there
  std::string text;         // in words
  bool wrong_kind = false;  // what it explains has to be something else

  // Not for its size or what the sensors resolve: whether anything is missing is then open.
  bool leaves_doubt() const { return rule != "size" && rule != "sensors"; }
};

// Structure that no effect of the catalogue explains.
struct Structure {
  std::string regressor;               // t, theta_m, i_q, i_d, omega_m, direction
  double share = 0;                    // of the residual's power in its equation
  std::string equation, channel;       // channel: d, q, torque
  double frequency_Hz = 0, order = 0;  // of a line
  bool bursts = false;                 // now and then, whatever the regressor
  std::string doubt;                   // why it may be no effect, in words; empty: confirmed
  std::string text;
};

// A moment at which the drive changes.
struct DriveChange {
  double t_s = 0, from_s = 0, to_s = 0;  // of the file's time, and the range that it may lie in
  std::string file;                      // where there are several
  std::string between;                   // two files, where it is their border: no time then
  std::string before, behind;            // kinds named before and behind it
};

struct ErrorPair {
  double train = 0, held_out = 0;
};

// A table over one variable that describes such structure without explaining it; linear between its
// points, constant beyond them (trace/correction.hpp).
struct CorrectionTable {
  std::string regressor, channel;  // theta_m (rad, wrapped), omega_m, i_d, i_q, direction; d, q ..
  bool periodic = false;
  std::vector<double> x, value;  // SI
  ErrorPair before, after;       // rms of the channel's residual without it and with it
  double at(double regressor_value) const;
};
struct EquationError {
  std::string unit;
  ErrorPair before, after;
  double no_change = 0, noise_floor = 0;
  double whiteness_p_value = 0;
  std::size_t rows = 0;
};

// Errors over one file: over its rows that judge, where it has some.
struct FileError {
  std::string path;
  bool held_out = false;
  std::string unit;
  std::size_t rows = 0;
  double no_change = 0, before = 0, after = 0;
  double noise = std::numeric_limits<double>::quiet_NaN();  // not a number: not known
  std::vector<std::string> signals = {};                    // that the error is made of
};

// A series for the pictures, at the tracer's rate.
struct TraceSeries {
  std::vector<double> t, theta_m, omega_m, i_d, i_q, before, after;
  std::vector<char> held_out;
  double rate_Hz = 0;
};

// What is left before and after, of a set without time or of v_dc: its points in ascending order of
// x. `heading`, `note`: of the section it stands in; empty: that of the sets.
struct TracePicture {
  std::string heading, note;
  std::string title, x_label, y_label;
  std::vector<double> x, before, after;
  std::vector<char> held_out;
};

struct TraceResult {
  std::string verdict;       // traced, nothing_missing, unexplained, ambiguous, inconsistent
  std::string sentence;      // the verdict for people
  bool interrupted = false;  // what was found until then, not judged
  std::vector<std::string> sources, held_out_sources;
  std::vector<std::string> health;  // what the samples themselves show, one line each
  std::vector<TracedEffect> effects;
  std::vector<TracedEffect> stop_gaps;  // describe a structure outside the catalogue
  std::vector<Rejected> rejected;
  std::vector<Refused> refused;
  std::vector<Inconsistency> inconsistent;
  std::vector<Ambiguity> ambiguous;
  std::vector<Structure> unexplained;
  std::vector<DriveChange> changes;
  std::vector<CorrectionTable> corrections;  // of the unexplained, as stop-gaps
  std::vector<char> judging;  // of each row of the record: whether it judged; empty: none was asked
  bool structured = false;
  std::optional<EquationError> electrical, mechanical;
  std::optional<EquationError> bus;  // v_dc, where a ripple of it was found
  std::string main_equation;         // whose error stands at the top of "error"
  double horizon_s = 0;
  std::vector<FileError> files;            // where several make up the errors
  std::vector<TracedParameter> constants;  // of the machine, as the data have them
  std::vector<std::string> identifiable;
  std::vector<std::pair<std::string, std::string>> not_identifiable;  // kind, why
  std::vector<std::string> excluded;  // kinds that were not looked for (trace/considered.hpp)
  TraceSeries series_d, series_q, series_torque;
  std::vector<TracePicture> pictures;  // where there are no series
  double seconds = 0;
};

// Kinds that the data cannot show and, behind them, those that were not looked for; why.
std::vector<std::pair<std::string, std::string>> not_shown(const TraceResult& result);

// Parameters of an effect with their standard deviations by key, where there is one.
std::vector<TracedParameter> traced_parameters(const Effect& effect,
                                               const std::map<std::string, double>& sigma);

// trace.json; numbers that are not finite become null.
std::string to_json(const TraceResult& result);

}  // namespace twinrate
