// Messages as named numbers and texts, in the order of lcmtypes/, for every export format.
//
// The header (seq, t_ns, session) and the tag are not among the fields. The suffix of a name is its
// unit. Arrays keep their length.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "core/channels.hpp"

namespace twinrate {

// Interpolation of a number between two samples.
enum class FieldKind {
  kLinear,  // linear
  kAngle,   // linear along the shorter arc
  kHeld,    // the earlier sample: whole numbers, flags, arrays of a filter
  kMean,    // the sample is the mean up to the next sample
};

struct Field {
  std::string name;
  FieldKind kind = FieldKind::kLinear;
  bool array = false;
  std::size_t count = 1;  // in the sample that defined the layout
  bool whole = false;     // of whole numbers: Sample::wholes has them exactly
};

struct Layout {
  std::vector<Field> numbers;
  std::vector<std::string> texts;
};

// The data that restore a message from a sample, besides the fields.
struct Origin {
  std::int64_t session = 0, tag = 0;
  std::int64_t timestamp_us = 0;  // of the event in the log
  std::int64_t event = -1;  // number among the messages exported; -1: not one message (resampled)
};

struct Sample {
  std::int64_t k = -1;
  std::int64_t t_ns = 0;
  Origin origin = {};
  std::vector<double> numbers;       // one field after the other
  std::vector<std::int64_t> wholes;  // beside each number of a whole field its exact value
  std::vector<std::size_t> counts;   // of each field
  std::vector<std::string> texts;
};

// False if the bytes are no message of that channel. `layout` may be null.
bool read_sample(Channel channel, const void* bytes, std::size_t size, Sample& sample,
                 Layout* layout);

}  // namespace twinrate
