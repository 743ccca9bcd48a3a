#include "trace/decimals.hpp"

#include <cmath>

namespace twinrate {

void Decimals::add(double value) {
  if (value == last_ || value == 0 || !std::isfinite(value)) return;
  last_ = value;
  Decade& decade = decades_[static_cast<int>(std::floor(std::log10(std::abs(value))))];
  ++decade.changes;
  const auto whole = [](double x) { return std::abs(x - std::round(x)) < 1e-4; };
  while (decade.decimals < kMost && !whole(value * std::pow(10, decade.decimals)))
    ++decade.decimals;
}

double Decimals::digit() const {
  for (auto it = decades_.rbegin(); it != decades_.rend(); ++it)
    if (const auto& [decimals, changes] = it->second; changes >= kFewest)
      return decimals < kMost ? std::pow(10, -decimals) : 0;
  return 0;
}

}  // namespace twinrate
