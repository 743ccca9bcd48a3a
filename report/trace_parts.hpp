// The parts of the page of a trace, as JSON for report.js (see parts.hpp).
#pragma once
#include "report/figure.hpp"
#include "report/trace_curves.hpp"
#include "trace/result.hpp"

namespace twinrate::report {

// Name ("d voltage") and unit of the channels d, q, torque.
struct ChannelWords {
  std::string name, unit;
};
ChannelWords words_of(const std::string& channel);
const TraceSeries& series_of(const TraceResult& result, const std::string& channel);

// trace_effects.cpp: the pictures of one effect. Null if the effect has no views (detected in the
// raw samples).
Json effect_section(const TraceResult& result, const TracedEffect& effect, int n_p,
                    const std::string& heading, const std::string& note);

// trace_residuals.cpp: residuals before and after, over time and angle and as spectra; the
// remaining structure and its correction.
std::vector<Json> residual_sections(const TraceResult& result);
std::vector<Json> picture_sections(const TraceResult& result);
std::vector<Json> unexplained_sections(const TraceResult& result, int n_p);

// trace_tables.cpp
std::string number_with_sigma(double value, const std::optional<double>& sigma);
std::string parameters_text(const TracedEffect& effect);
Json effects_table(const TraceResult& result);
Json errors_table(const TraceResult& result);
Json files_table(const TraceResult& result);  // a row for every file
Json refused_table(const TraceResult& result);
Json inconsistent_table(const TraceResult& result);
std::vector<Json> closing_sections(const TraceResult& result);

// Points with error bars, separately for training and held-out rows, and the effect's curve.
Figure bins_figure(const Bins& bins);

}  // namespace twinrate::report
