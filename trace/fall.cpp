#include "trace/fall.hpp"

#include <fmt/format.h>

namespace twinrate {

std::optional<std::string> fall_in_words(double before, double after, const std::string& unit) {
  const std::string from = fmt::format("{:.3g}", before), to = fmt::format("{:.3g}", after);
  if (!(after < before) || from == to) return std::nullopt;
  return fmt::format("falls from {} to {} {}", from, to, unit);
}

}  // namespace twinrate
