#include "core/percent_line.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <cstdio>

#include "core/process.hpp"

namespace twinrate {

PercentLine::PercentLine(Form form)
    : form_(form == Form::kTerminal && !isatty(STDERR_FILENO) ? Form::kNone : form) {}

void PercentLine::show(const std::string& what, double share) {
  if (stop_signalled()) throw Stopped{};
  if (form_ == Form::kNone) return;
  const int step = form_ == Form::kJson ? 10 : 1;
  const int percent = static_cast<int>(100 * share) / step * step;
  if (percent == shown_ && what == what_) return;
  if (form_ == Form::kJson)
    fmt::print("{{\"progress\": \"{} {} %\"}}\n", what, percent);
  else
    fmt::print(stderr, "\r\033[K{} {} %", what, percent);
  std::fflush(form_ == Form::kJson ? stdout : stderr);
  what_ = what;
  shown_ = percent;
}

void PercentLine::clear() {
  if (form_ == Form::kTerminal && shown_ >= 0) fmt::print(stderr, "\r\033[K");
  shown_ = -1;
}

}  // namespace twinrate
