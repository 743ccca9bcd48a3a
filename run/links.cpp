#include "run/links.hpp"

#include <algorithm>

namespace twinrate {

Links::Links(const std::set<Role>& roles) {
  for (const Role role : roles) links_[role];
}

bool Links::due(std::int64_t now_ns) const {
  return !links_.empty() && static_cast<double>(now_ns - asked_ns_) >= 1e9 * kPeriod_s;
}

request_t Links::ask(std::int64_t now_ns) {
  asked_ns_ = now_ns;
  for (auto& [role, link] : links_) {
    ++link.asked;
    link.open.push_back(now_ns);
    while (static_cast<double>(now_ns - link.open.front()) > 1e9 * kLost_s) link.open.pop_front();
  }
  request_t request{};
  request.seq = request.t_ns = now_ns;
  request.kind = static_cast<std::int32_t>(RequestKind::kClock);
  return request;
}

void Links::take(const reply_t& reply, std::int64_t now_ns) {
  const auto found = links_.find(static_cast<Role>(reply.role));
  if (found == links_.end()) return;
  Link& link = found->second;
  const auto open = std::find(link.open.begin(), link.open.end(), reply.seq);
  if (open == link.open.end()) return;
  link.open.erase(open);
  const Trip trip{now_ns - reply.seq, reply.t_ns - (reply.seq + (now_ns - reply.seq) / 2)};
  link.host = reply.text;
  link.window.push_back(trip);
  if (link.window.size() > kWindow) link.window.pop_front();
  const double us = 1e-3 * static_cast<double>(trip.round_ns);
  if (link.round_trips_us.size() < kRoundTripsKept)
    link.round_trips_us.push_back(us);
  else
    link.round_trips_us[static_cast<std::size_t>(link.answered) % kRoundTripsKept] = us;
  ++link.answered;
}

std::string Links::name_of(Role role) const {
  const auto found = links_.find(role);
  const std::string name = role_name(static_cast<int>(role));
  return found == links_.end() || found->second.host.empty() ? name
                                                             : name + " on " + found->second.host;
}

std::vector<LinkFigures> Links::figures(std::int64_t now_ns) const {
  std::vector<LinkFigures> list;
  for (const auto& [role, link] : links_) {
    LinkFigures f{.role = role, .host = link.host, .asked = link.asked};
    const auto waiting = std::count_if(link.open.begin(), link.open.end(), [&](std::int64_t s0) {
      return static_cast<double>(now_ns - s0) <= 1e9 * kLost_s;
    });
    f.lost = link.asked - link.answered - waiting;
    const auto shortest =
        std::min_element(link.window.begin(), link.window.end(),
                         [](const Trip& a, const Trip& b) { return a.round_ns < b.round_ns; });
    if (shortest != link.window.end()) {
      f.offset_ns = shortest->offset_ns;
      f.error_ns = (shortest->round_ns + 1) / 2;
    }
    std::vector<double> round_trips = link.round_trips_us;
    f.round_trip_us = percentiles_of(round_trips);
    list.push_back(f);
  }
  return list;
}

}  // namespace twinrate
