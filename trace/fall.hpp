// "falls from A to B": said in one place, and only where it does.
#pragma once
#include <optional>
#include <string>

namespace twinrate {

// Empty where `after` is not below `before`, as printed.
std::optional<std::string> fall_in_words(double before, double after, const std::string& unit);

}  // namespace twinrate
