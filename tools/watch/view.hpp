// What `twinrate watch` shows, as text for people and as one JSON line.
#pragma once
#include <string>

#include "tools/watch/watcher.hpp"

namespace twinrate {

// Several lines, each ended; `width` 0: unlimited. Says so where nothing was heard lately.
std::string view_text(const Watcher& watcher, const std::string& url, std::size_t width);
std::string view_json(const Watcher& watcher, const std::string& url);

// "nothing heard on URL for 3 s: .."; empty while messages come.
std::string silence_text(const Watcher& watcher, const std::string& url);

}  // namespace twinrate
