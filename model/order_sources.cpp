#include "model/order_sources.hpp"

#include <cassert>
#include <numeric>

namespace twinrate {
namespace {

struct Names {
  const char* in_words;
  const char* in_figures;
};

// By Source.
constexpr Names kNames[] = {
    {"shaft: friction over a turn, misalignment", "shaft"},
    {"current offset", "offset"},
    {"current scaling", "scaling"},
    {"dead time and flux harmonics", "dead time/flux"},
    {"cogging from the poles", "poles"},
    {"cogging from the slots", "slots"},
    {"native cogging", "native"},
    {"current offset times another source", "offset product"},
};

std::string joined(const std::vector<OrderSource>& sources, const char* between,
                   const char* (*name)(Source)) {
  std::string text;
  for (const OrderSource& source : sources) {
    if (!text.empty()) text += between;
    text += name(source.source);
  }
  return text;
}

}  // namespace

std::vector<OrderSource> order_sources(int N, int n_p, int n_slots) {
  assert(N >= 1 && n_p >= 1 && n_slots >= 0);
  std::vector<OrderSource> sources;
  const auto once = [&](Source source, int order) {
    if (N == order) sources.push_back({source, 1});
  };
  const auto multiples = [&](Source source, int order) {
    if (N % order == 0) sources.push_back({source, N / order});
  };
  const int n_poles = 2 * n_p;
  once(Source::kShaft, 1);
  once(Source::kCurrentOffset, n_p);
  once(Source::kCurrentScaling, n_poles);
  multiples(Source::kDeadTimeAndFlux, 3 * n_poles);
  multiples(Source::kPoleCogging, n_poles);
  if (n_slots > 0) {
    multiples(Source::kSlotCogging, n_slots);
    multiples(Source::kNativeCogging, std::lcm(n_slots, n_poles));
  }
  if (sources.empty()) multiples(Source::kOffsetProduct, n_p);
  return sources;
}

const char* long_name(Source source) {
  return kNames[static_cast<int>(source)].in_words;
}

const char* short_name(Source source) {
  return kNames[static_cast<int>(source)].in_figures;
}

std::string describe(const std::vector<OrderSource>& sources) {
  return joined(sources, "; ", long_name) +
         (sources.size() > 1 ? ": cannot be told apart at one speed and load" : "");
}

std::string label(const std::vector<OrderSource>& sources) {
  return joined(sources, "+", short_name);
}

}  // namespace twinrate
