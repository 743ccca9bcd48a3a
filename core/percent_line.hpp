// Progress of a long reading: a line on a terminal that overwrites itself, or JSON lines.
#pragma once
#include <string>

namespace twinrate {

// Thrown by PercentLine::show after Ctrl-C.
struct Stopped {};

class PercentLine {
 public:
  enum class Form { kNone, kTerminal, kJson };  // kTerminal: stderr, silent without a terminal
  explicit PercentLine(Form form);
  ~PercentLine() { clear(); }
  PercentLine(const PercentLine&) = delete;
  PercentLine& operator=(const PercentLine&) = delete;
  // `share`: 0 to 1 of `what`. JSON lines come every ten percent: {"progress": "reading 40 %"}.
  void show(const std::string& what, double share);
  void clear();

 private:
  Form form_;
  std::string what_;
  int shown_ = -1;
};

}  // namespace twinrate
