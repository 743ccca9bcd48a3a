// The digits with which a file has a signal.
#pragma once

namespace twinrate {

// The last decimal of the largest values of a signal, as a file has them.
class Decimals {
 public:
  void add(double value);
  double digit() const;  // 0: beyond the seventh

 private:
  static constexpr int kMost = 8;
  double decade_ = 0;  // of the largest value, a power of ten
  int decimals_ = 0;   // of the values in it
};

}  // namespace twinrate
