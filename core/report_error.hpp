// The line with which a program ends, and its exit code.
#pragma once
#include <string>
#include <string_view>

namespace twinrate {

// One line of UTF-8: control characters, and bytes that are no UTF-8, are written as "\xNN". Of a text
// longer than 8192 bytes (two paths of the longest kind) the middle is left out.
std::string printable(std::string_view text);

// Throws BadInput for an argument that is not UTF-8: JSON, TOML and messages cannot hold it.
void expect_utf8(int argc, const char* const* argv);

// In a catch block: prints "PROGRAM: what()" on stderr. Returns 2 for bad input, 3 if the machine
// cannot do the task, else 1. A path that the file system refuses (too long, a circle of links, no
// permission) is bad input; a full disk is not.
int report_error(std::string_view program);

// At the end of a program with output: returns the exit code, or 1 with one line on stderr if the
// output could not be written (disk full). A closed output is no error.
int finish_output(std::string_view program, int exit_code);

}  // namespace twinrate
