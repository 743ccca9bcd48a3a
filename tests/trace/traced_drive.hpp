// A trace of a log of the synthetic drive, and what it named.
#pragma once

#include <algorithm>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "tests/trace/synthetic_drive.hpp"
#include "trace/tracer.hpp"

namespace twinrate {

inline TraceResult trace_of(const RawLog& raw) {
  Health health;
  const Record record = make_record(raw, 3, health);
  return trace_record(record, servo(), health, {});
}

inline std::vector<std::string> kinds(const TraceResult& r) {
  std::vector<std::string> list;
  for (const TracedEffect& e : r.effects) list.emplace_back(e.effect->kind());
  std::sort(list.begin(), list.end());
  return list;
}

inline const TracedParameter& parameter(const TraceResult& r, std::string_view kind,
                                        std::string_view name) {
  for (const TracedEffect& e : r.effects)
    if (e.effect->kind() == kind)
      for (const TracedParameter& p : e.parameters)
        if (p.name == name) return p;
  throw std::logic_error("no such parameter");
}

using Names = std::vector<std::string>;

}  // namespace twinrate
