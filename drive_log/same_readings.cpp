#include "drive_log/same_readings.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <bit>

#include "core/config.hpp"

namespace twinrate {
namespace {

constexpr std::size_t kStretch = 64;             // rows
constexpr std::uint64_t kPrime = 1099511628211;  // of FNV-1a

// Of each stretch of kStretch rows that begins at a multiple of `every`, and in which a reading changes: two
// runs at rest have the same readings.
template <class Take>
void for_each_stretch(const std::vector<std::uint64_t>& rows, std::size_t every, Take take) {
  std::uint64_t power = 1;
  for (std::size_t i = 0; i < kStretch; ++i) power *= kPrime;
  std::uint64_t hash = 0;     // of the last kStretch rows
  std::size_t unchanged = 0;  // the last rows that are equal
  for (std::size_t k = 0; k < rows.size(); ++k) {
    unchanged = k > 0 && rows[k] == rows[k - 1] ? unchanged + 1 : 1;
    hash = hash * kPrime + rows[k];
    if (k >= kStretch) hash -= power * rows[k - kStretch];
    if (k + 1 >= kStretch && (k + 1 - kStretch) % every == 0 && unchanged < kStretch) take(hash);
  }
}

}  // namespace

std::uint64_t reading_hash(std::initializer_list<double> readings) {
  std::uint64_t hash = 14695981039346656037U;
  for (const double reading : readings)
    hash = (hash ^ std::bit_cast<std::uint32_t>(static_cast<float>(reading + 0.0))) *
           kPrime;  // -0 is 0
  return hash;
}

bool has_the_readings_of(const std::vector<std::uint64_t>& others,
                         const std::vector<std::uint64_t>& rows) {
  std::vector<std::uint64_t> there;
  there.reserve(others.size());
  for_each_stretch(others, 1, [&](std::uint64_t hash) { there.push_back(hash); });
  std::sort(there.begin(), there.end());
  std::size_t stretches = 0, found = 0;
  for_each_stretch(rows, kStretch, [&](std::uint64_t hash) {
    ++stretches;
    found += std::binary_search(there.begin(), there.end(), hash);
  });
  return 2 * found > stretches;
}

void expect_other_readings(const std::vector<ReadRows>& files) {
  for (const ReadRows& held : files)
    for (const ReadRows& fitted : files)
      if (held.held_out && !fitted.held_out && has_the_readings_of(fitted.rows, held.rows))
        throw BadInput(fmt::format(
            "--holdout {}: has the readings of {}, which is fitted; another run allowed", held.path,
            fitted.path));
}

}  // namespace twinrate
