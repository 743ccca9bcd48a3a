// The result of a trace: the contract's trace.json, and the data of the report page.
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
  std::optional<double> sigma;  // one standard deviation; none if it was not fitted
  std::string text;             // name of a choice, instead of a value
};

// Contribution of one effect to one channel, row by row of that channel's TraceSeries (V, Nm).
struct EffectView {
  std::string channel;          // d, q, torque
  std::vector<double> without;  // residual of the model with all the other effects
  std::vector<double> share;    // the part of it that this effect removes
};

struct TracedEffect {
  std::shared_ptr<const Effect> effect;
  std::string equation;  // electrical, mechanical, sensing
  std::vector<TracedParameter> parameters;
  double held_out_gain = 0;          // share of the held-out error that the effect removes
  double delta_bic = 0;              // of the training score, negative: better
  double p_value = 1;                // of the gain or the size, under no effect
  double materiality = 0;            // size over the smallest worth reporting
  std::vector<std::string> aliases;  // kinds that explain the same as well
  bool only_in_log = false;          // affects the logged values, not those that the drive uses
  // Of an effect in a part of the record (trace/change_points.hpp): its begin and end, if they are
  // inside a file, and the files of the part.
  bool only_in_part = false;
  std::optional<double> from_s, to_s;
  std::vector<std::string> files;
  bool from_samples = false;      // found in the raw samples (clipping, missing rows), not fitted
  std::vector<EffectView> views;  // for the pictures: the channels in which it is visible
};

// A kind that was considered and the reason why it is not among the effects.
struct Rejected {
  std::string kind;
  double score_gain = 0, held_out_gain = 0;
  std::string why;
};

struct Ambiguity {
  std::vector<std::string> kinds;
  std::string why, would_separate;
};

// A contradiction between the log and the drive file: a unit, a scale, another machine.
struct Inconsistency {
  std::string quantity;         // a column, or a parameter of the machine
  std::string expected, found;  // ranges in words, with units
  std::string hint;             // the possible cause, as a question
  std::string file = {};        // of several, the one that does not belong; empty: all, or one
};

// A claim that did not pass the gate (trace/gate.hpp).
struct Refused {
  std::string kind;
  std::string rule;         // sensors, transfer, agreement, alone, size, physical, whole
  std::string file;         // the file on which it failed; empty: all of them together
  double number = 0;        // of the rule
  bool left = false;        // it lowers the error of rows that judge: an effect is present
  std::string text;         // in words
  bool wrong_kind = false;  // its part of the residual has another cause

  // False for its size and for the resolution of the sensors. If true, an effect may be missing.
  bool leaves_doubt() const { return rule != "size" && rule != "sensors"; }
};

// Structure that no effect of the catalogue explains.
struct Structure {
  std::string regressor;               // t, theta_m, i_q, i_d, omega_m, direction
  double share = 0;                    // of the residual's power in its equation
  std::string equation, channel;       // channel: d, q, torque
  double frequency_Hz = 0, order = 0;  // of a line
  bool bursts = false;                 // intermittent, independent of the regressor
  std::string doubt;                   // why it may be no effect, in words; empty: confirmed
  std::string text;
};

// A moment at which the drive changes.
struct DriveChange {
  double t_s = 0, from_s = 0, to_s = 0;  // in the file's time; the range that contains it
  std::string file;                      // set if there are several
  std::string between;                   // two files, if it is their border; then no time
  std::string before, behind;            // kinds named before it and after it
};

struct ErrorPair {
  double train = 0, held_out = 0;
};

// A table over one variable that describes such a structure without naming a cause; linear between
// its points, constant beyond them (trace/correction.hpp).
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

// Errors over one file: over its judging rows if it has some.
struct FileError {
  std::string path;
  bool held_out = false;
  std::string unit;
  std::size_t rows = 0;
  double no_change = 0, before = 0, after = 0;
  double noise = std::numeric_limits<double>::quiet_NaN();  // not a number: unknown
  std::vector<std::string> signals = {};                    // from which the error is computed
};

// A series for the pictures, at the tracer's rate.
struct TraceSeries {
  std::vector<double> t, theta_m, omega_m, i_d, i_q, before, after;
  std::vector<char> held_out;
  double rate_Hz = 0;
};

// Residual before and after, of a set without time or of v_dc: its points in ascending order of x.
// `heading`, `note`: of its section; empty: that of the sets.
struct TracePicture {
  std::string heading, note;
  std::string title, x_label, y_label;
  std::vector<double> x, before, after;
  std::vector<char> held_out;
};

struct TraceResult {
  std::string verdict;       // traced, nothing_missing, unexplained, ambiguous, inconsistent
  std::string sentence;      // the verdict for people
  bool interrupted = false;  // the effects found so far, not judged
  std::vector<std::string> sources, held_out_sources;
  std::vector<std::string> health;  // findings from the samples, one line each
  std::vector<TracedEffect> effects;
  std::vector<TracedEffect> stop_gaps;  // describe a structure outside the catalogue
  std::vector<Rejected> rejected;
  std::vector<Refused> refused;
  std::vector<Inconsistency> inconsistent;
  std::vector<Ambiguity> ambiguous;
  std::vector<Structure> unexplained;
  std::vector<DriveChange> changes;
  std::vector<CorrectionTable> corrections;  // of the unexplained, as stop-gaps
  std::vector<char> judging;                 // of each row of the record; empty: no row was asked
  bool structured = false;
  std::optional<EquationError> electrical, mechanical;
  std::optional<EquationError> bus;  // v_dc, if a ripple was found
  std::string main_equation;         // whose error is the first in "error"
  double horizon_s = 0;
  std::vector<FileError> files;            // if several make up the errors
  std::vector<TracedParameter> constants;  // of the machine, from the data
  std::vector<std::string> identifiable;
  std::vector<std::pair<std::string, std::string>> not_identifiable;  // kind, why
  std::vector<std::string> excluded;  // kinds that were not looked for (trace/considered.hpp)
  TraceSeries series_d, series_q, series_torque;
  std::vector<TracePicture> pictures;  // if there are no series
  double seconds = 0;
};

// Kinds that the data cannot show, followed by the excluded kinds, with the reason.
std::vector<std::pair<std::string, std::string>> not_shown(const TraceResult& result);

// Parameters of an effect with their standard deviations by key, if known.
std::vector<TracedParameter> traced_parameters(const Effect& effect,
                                               const std::map<std::string, double>& sigma);

// trace.json; numbers that are not finite become null.
std::string to_json(const TraceResult& result);

}  // namespace twinrate
