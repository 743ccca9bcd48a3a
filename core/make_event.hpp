#pragma once
#include <optional>
#include <string>

#include "core/channels.hpp"
#include "core/reason.hpp"

namespace twinrate {

struct EventFacts {
  Role role = Role::kSupervisor;  // its sender
  Reason reason = Reason::kNone;
  std::int64_t k = -1, t_ns = 0;
  std::string text;
  std::optional<Role> waited_for = {};
};

inline event_t make_event(const EventFacts& facts, std::int64_t session = 0) {
  event_t event{};
  event.seq = facts.k;
  event.t_ns = facts.t_ns;
  event.session = session;
  event.role = static_cast<std::int32_t>(facts.role);
  event.reason = static_cast<std::int32_t>(facts.reason);
  event.waited_for = facts.waited_for ? static_cast<std::int32_t>(*facts.waited_for) : -1;
  event.text = facts.text;
  return event;
}

}  // namespace twinrate
