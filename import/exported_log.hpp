// A log from its export: the messages of an mcap or mat file of `twinrate export`, bit for bit.
//
// Every field, the header and the tag are restored exactly, in the order of the log. Not in the
// file: channels that were not exported (ACK unless requested) and numbers that are not finite,
// which an mcap stores as null and which are restored as NaN. A resampled export is no log and is
// refused.
#pragma once
#include <functional>
#include <map>
#include <string>

namespace twinrate {

// True for a file whose name ends in .mcap, and for a .mat with the streams of an export.
bool is_exported_log(const std::string& path);

// Writes the log; returns the number of messages by channel. Throws BadInput, one line: no such
// file, damaged, a file of another program, resampled, a message that no process sends.
std::map<std::string, std::int64_t> import_exported_log(
    const std::string& path, const std::string& out, const std::function<void(double)>& progress);

}  // namespace twinrate
