#include "trace/decimals.hpp"

#include <cmath>

namespace twinrate {

void Decimals::add(double value) {
  const double size = std::abs(value);
  if (size < decade_) return;
  if (size >= 10 * decade_) {
    decade_ = std::pow(10, std::floor(std::log10(size)));
    decimals_ = 0;
  }
  const auto whole = [](double x) { return std::abs(x - std::round(x)) < 1e-4; };
  while (decimals_ < kMost && !whole(value * std::pow(10, decimals_))) ++decimals_;
}

double Decimals::digit() const {
  return decade_ > 0 && decimals_ < kMost ? std::pow(10, -decimals_) : 0;
}

}  // namespace twinrate
