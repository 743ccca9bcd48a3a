// The view of `twinrate watch`, as text and as one JSON line.
#pragma once
#include <string>

#include "tools/watch/watcher.hpp"

namespace twinrate {

// Lines with line ends; `width` 0: unlimited. Reports a silent bus.
std::string view_text(const Watcher& watcher, const std::string& url, std::size_t width);
std::string view_json(const Watcher& watcher, const std::string& url);

// "nothing heard on URL for 3 s: .."; empty while messages come.
std::string silence_text(const Watcher& watcher, const std::string& url);

}  // namespace twinrate
