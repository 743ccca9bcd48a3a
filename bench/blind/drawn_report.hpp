// Results on drawn machines, as rows for a file and as tables.
#pragma once
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "bench/blind/drawn_log.hpp"

namespace twinrate::blind {

struct DrawnRow {
  std::string name, profile, mode, encoder;  // encoder: class of counts
  bool counts_declared = false;
  double rate_Hz = 0;
  std::vector<std::string> truth, visible;   // visible: kinds that the log can show
  std::map<std::string, double> deviations;  // of the true kinds (drawn_visible.hpp)
  std::vector<std::string> found;            // kinds, with their aliases
  std::string verdict, sentence;             // verdict "error": the program failed
  std::string spoilt;                        // a slip or a hidden effect; "": as drawn
  std::vector<std::string> wrong;            // kinds named that are not in the truth
  std::vector<std::string> missed;           // true kinds not named
  bool exact = false;                        // the true kinds, up to alias groups, and nothing else
  bool right = false;                        // the same for the visible true kinds
  bool large_group = false;      // an alias group of more than three kinds counted as right
  bool flawed_sentence = false;  // "falls from A to B", B >= A
  double seconds = 0;            // of CPU time; if that is not stored, of the trace's own clock
  bool false_claim() const { return verdict == "traced" && !wrong.empty(); }
};

// Compares a trace.json with the truth.
DrawnRow compare(const DrawnCase& which, const std::vector<std::string>& truth,
                 const std::vector<std::string>& visible, const nlohmann::json& trace);
nlohmann::ordered_json to_json(const DrawnRow& row);
// Tables by profile, mode, encoder and number of effects, as Markdown.
std::string tables(const std::vector<DrawnRow>& rows);

}  // namespace twinrate::blind
