// The signals of the scope: every number of every message, and signals computed from messages of
// the same tick. The index of a signal is its column in the TickStore.
#pragma once
#include <array>
#include <map>
#include <string>
#include <vector>

#include "scope/message_layout.hpp"

namespace twinrate::scope {

struct Signal {
  std::string name;  // "estimate.omega_m_rad_s", "gain.P[24]", "status.plant.gaps", "drive.u_q_V"
  std::string unit;  // "rad/s"
  std::string comment;  // meaning, from lcmtypes/
  bool dense = false;   // a value nearly every tick
};

class SignalTable {
 public:
  // The column of a name; -1 if there is none.
  int find(const std::string& name) const;
  int add(Signal signal);
  // The column of an element of a message's field. `speaker`: the sender on channels that every
  // process uses, else "".
  int of_message(Channel channel, const std::string& speaker, int field, int element);
  const std::vector<Signal>& list() const { return list_; }
  const Signal& operator[](int column) const { return list_[static_cast<std::size_t>(column)]; }

 private:
  std::vector<Signal> list_;
  std::map<std::string, int> by_name_;
  using Columns = std::vector<std::vector<int>>;  // by field and element
  std::array<Columns, kChannelCount> of_channel_;
  std::map<std::string, Columns> of_speaker_;
};

}  // namespace twinrate::scope
