#include "core/report_error.hpp"

#include <fmt/format.h>

#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <exception>
#include <filesystem>
#include <iostream>

#include "core/config.hpp"
#include "core/machine_error.hpp"
#include "core/utf8.hpp"

namespace twinrate {
namespace {

constexpr std::size_t kMaxLineBytes = 8192;

void append_printable(std::string& line, std::string_view text) {
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(text.data());
  for (std::size_t i = 0; i < text.size();) {
    const std::size_t length = utf8_sequence(bytes + i, text.size() - i);
    if (length == 0 || bytes[i] < 0x20 || bytes[i] == 0x7f) {
      line += fmt::format("\\x{:02x}", bytes[i]);
      ++i;
    } else {
      line += text.substr(i, length);
      i += length;
    }
  }
}

int report(std::string_view program, std::string_view what, int exit_code) {
  fmt::print(stderr, "{}: {}\n", program, printable(what));
  return exit_code;
}

// Errors that do not depend on the name: the same name may succeed another time.
bool is_of_the_machine(const std::error_code& code) {
  return code == std::errc::no_space_on_device || code == std::errc::io_error ||
         code == std::errc::too_many_files_open || code == std::errc::not_enough_memory;
}

}  // namespace

std::string printable(std::string_view text) {
  std::string line;
  if (text.size() <= kMaxLineBytes) {
    append_printable(line, text);
    return line;
  }
  append_printable(line, text.substr(0, kMaxLineBytes / 2));
  line += " .. ";
  append_printable(line, text.substr(text.size() - kMaxLineBytes / 2));
  return line;
}

void expect_utf8(int argc, const char* const* argv) {
  for (int i = 1; i < argc; ++i) {
    const std::string_view text = argv[i];
    const auto* bytes = reinterpret_cast<const std::uint8_t*>(text.data());
    for (std::size_t at = 0; at < text.size();) {
      const std::size_t length = utf8_sequence(bytes + at, text.size() - at);
      if (length == 0) throw BadInput(fmt::format("{}: only UTF-8 allowed in an argument", text));
      at += length;
    }
  }
}

int finish_output(std::string_view program, int exit_code) {
  errno = 0;
  std::cout.flush();  // stdout with it
  const bool failed = std::fflush(stdout) != 0 || std::ferror(stdout) || !std::cout;
  if (!failed || errno == EBADF) return exit_code;
  report(program,
         fmt::format("the output cannot be written{}{}", errno ? ": " : "",
                     errno ? std::strerror(errno) : ""),
         1);
  return exit_code != 0 ? exit_code : 1;
}

int report_error(std::string_view program) {
  try {
    throw;
  } catch (const BadInput& error) {
    return report(program, error.what(), 2);
  } catch (const MachineError& error) {
    return report(program, error.what(), 3);
  } catch (const std::filesystem::filesystem_error& error) {
    return report(program, fmt::format("{}: {}", error.path1().string(), error.code().message()),
                  is_of_the_machine(error.code()) ? 1 : 2);
  } catch (const std::bad_alloc&) {
    return report(program, "out of memory", 1);
  } catch (const std::exception& error) {
    return report(program, error.what(), 1);
  }
}

}  // namespace twinrate
