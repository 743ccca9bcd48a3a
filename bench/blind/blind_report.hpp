// Results of the blind test, as rows for a file and as tables.
#pragma once
#include <string>
#include <vector>

namespace twinrate::blind {

struct Row {
  std::string name, set;  // single, double, triple, poor, none
  std::vector<std::string> kinds, found;
  bool exact = false;          // true effects found, up to alias groups of at most three
  std::vector<double> sigmas;  // error of each parameter over its standard deviation
  // Ratio of the held-out error to that of the true model, for each equation; 0: no equation.
  double electrical_ratio = 0, mechanical_ratio = 0;
  double seconds = 0;  // of CPU time, one thread
};

std::vector<Row> read_rows(const std::string& path);  // file of write_rows()
void write_rows(const std::string& path, const std::vector<Row>& rows);
// Success rates by set, parameter errors in sigmas, held-out errors, and the confusion matrix of
// single effects, as Markdown.
std::string tables(const std::vector<Row>& rows);

}  // namespace twinrate::blind
