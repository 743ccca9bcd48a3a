#include "core/stall_text.hpp"

#include <fmt/format.h>

#include <cinttypes>
#include <cstdio>

namespace twinrate {

std::string stall_text(const StallCount& count) {
  return fmt::format(" ({} stalls, {:.6f} s in all, {:.6f} s at most)", count.stalls, count.stood_s,
                     count.longest_s);
}

std::optional<StallCount> stall_count_in(const std::string& text) {
  const auto begin = text.rfind(" (");
  StallCount count;
  int end = 0;
  if (begin == std::string::npos ||
      std::sscanf(text.c_str() + begin, " (%" SCNd64 " stalls, %lf s in all, %lf s at most)%n",
                  &count.stalls, &count.stood_s, &count.longest_s, &end) != 3 ||
      begin + static_cast<std::size_t>(end) != text.size())
    return {};
  return count;
}

}  // namespace twinrate
