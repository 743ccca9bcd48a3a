// The digits with which a file has a signal.
#pragma once
#include <map>

namespace twinrate {

// The last decimal of the largest values of a signal. A few values may end in zeros by chance, and a
// limit is one value: a decade counts with kFewest changes of the value within it.
class Decimals {
 public:
  void add(double value);
  double digit() const;  // 0: beyond the seventh, or unknown

 private:
  static constexpr int kMost = 8, kFewest = 30;
  struct Decade {
    int decimals = 0, changes = 0;
  };
  std::map<int, Decade> decades_;  // by the exponent of ten
  double last_ = 0;
};

}  // namespace twinrate
