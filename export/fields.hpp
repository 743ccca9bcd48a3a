// Messages as named numbers and texts, in the order of lcmtypes/; what every format of an export is
// made of.
//
// The header (seq, t_ns, session) stands apart. A field's unit is the end of its name. Arrays keep
// their length.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "core/channels.hpp"

namespace twinrate {

// What a number is between two samples.
enum class FieldKind {
  kLinear,  // a straight line
  kAngle,   // the same, the short way round
  kHeld,    // the earlier one: whole numbers, flags, arrays of a filter
  kMean,    // a mean from its sample to the next
};

struct Field {
  std::string name;
  FieldKind kind = FieldKind::kLinear;
  bool array = false;
  std::size_t count = 1;  // of the sample that the layout was made from
};

struct Layout {
  std::vector<Field> numbers;
  std::vector<std::string> texts;
};

struct Sample {
  std::int64_t k = -1;
  std::int64_t t_ns = 0;
  std::vector<double> numbers;      // one field after the other
  std::vector<std::size_t> counts;  // of each field
  std::vector<std::string> texts;
};

// False where the bytes are no message of that channel. `layout` may be null.
bool read_sample(Channel channel, const void* bytes, std::size_t size, Sample& sample,
                 Layout* layout);

}  // namespace twinrate
