// Reads a TOML file of unknown origin.
//
// The parser nests a table for every dot of a key, without a limit, and its recursion ends the
// program at some 100,000 of them: longer keys are refused before it sees them.
#pragma once
#include <toml++/toml.h>

#include <string>

namespace twinrate {

inline constexpr int kMaxKeyDots = 16;  // a drive file: 3

// The text of a file. Throws BadInput if it cannot be read, or is larger than the largest message
// (core/message_check.hpp): a log holds its drive file as one.
std::string read_text_file(const std::string& path);
// Throws BadInput: source:line and the error.
toml::table parse_toml(const std::string& text, const std::string& source);

}  // namespace twinrate
