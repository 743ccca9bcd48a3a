#include "scope/signal_table.hpp"

#include <fmt/format.h>

namespace twinrate::scope {
namespace {

bool is_dense(Channel channel) {
  return channel < Channel::kStatus && channel != Channel::kGain;
}

}  // namespace

int SignalTable::find(const std::string& name) const {
  const auto found = by_name_.find(name);
  return found == by_name_.end() ? -1 : found->second;
}

int SignalTable::add(Signal signal) {
  const int column = static_cast<int>(list_.size());
  by_name_[signal.name] = column;
  list_.push_back(std::move(signal));
  return column;
}

int SignalTable::of_message(Channel channel, const std::string& speaker, int field, int element) {
  const MessageLayout& layout = layout_of(channel);
  Columns& columns =
      speaker.empty() ? of_channel_[static_cast<std::size_t>(channel)] : of_speaker_[speaker];
  if (columns.empty()) columns.resize(layout.fields.size());
  std::vector<int>& elements = columns[static_cast<std::size_t>(field)];
  while (static_cast<int>(elements.size()) <= element) {
    const LayoutField& f = layout.fields[static_cast<std::size_t>(field)];
    std::string name = layout.short_name + (speaker.empty() ? "." : "." + speaker + ".") + f.wire;
    if (f.array) name += fmt::format("[{}]", elements.size());
    elements.push_back(add({name, f.unit, f.comment, is_dense(channel)}));
  }
  return elements[static_cast<std::size_t>(element)];
}

}  // namespace twinrate::scope
