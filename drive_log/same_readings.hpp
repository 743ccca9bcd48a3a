// Detects that a file has the readings of another: a copy, or an excerpt, under another name.
#pragma once
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <string>
#include <vector>

namespace twinrate {

// Hash of the readings of one row, in the precision of a float, because a copy may be text.
std::uint64_t reading_hash(std::initializer_list<double> readings);
// True if more than half of `rows` are in `others`, in stretches of 64 rows: a start from
// standstill without noise is the same in two runs.
bool has_the_readings_of(const std::vector<std::uint64_t>& others,
                         const std::vector<std::uint64_t>& rows);

// A file of --data or --holdout.
struct ReadRows {
  std::string path;
  bool held_out = false;
  std::vector<std::uint64_t> rows;  // reading_hash of each
};
// Throws BadInput if a held-out file has the readings of one that is not held out.
void expect_other_readings(const std::vector<ReadRows>& files);

}  // namespace twinrate
