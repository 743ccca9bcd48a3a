// What the tracer said of blind logs, as rows that can be kept, and as tables.
#pragma once
#include <string>
#include <vector>

namespace twinrate::blind {

struct Row {
  std::string name, set;  // single, double, triple, poor, none
  std::vector<std::string> kinds, found;
  bool exact = false;          // the true set, or an alias group of at most three that holds it
  std::vector<double> sigmas;  // error of each parameter over its standard deviation
  // Held-out error over that of the true model, by equation; 0 where there is none.
  double electrical_ratio = 0, mechanical_ratio = 0;
  double seconds = 0;  // of CPU time, one thread
};

std::vector<Row> read_rows(const std::string& path);  // of a file that write_rows() made
void write_rows(const std::string& path, const std::vector<Row>& rows);
// Shares by set, parameters within their sigmas, held-out errors, and the confusion matrix of
// single effects, as Markdown.
std::string tables(const std::vector<Row>& rows);

}  // namespace twinrate::blind
