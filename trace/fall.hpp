// The words "falls from A to B", used only if the value falls.
#pragma once
#include <optional>
#include <string>

namespace twinrate {

// Empty if `after` is not below `before` as printed.
std::optional<std::string> fall_in_words(double before, double after, const std::string& unit);

}  // namespace twinrate
