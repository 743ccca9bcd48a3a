// False claims of the tracer on drawn static sets and bus voltages.
//
//   point_sets [COUNT] [SEED] [SET] [-v]     COUNT cases of each set and class
// SET: 0 flux map, 1 inverter curve, 2 holding current, 3 bus voltage, else all. -v prints every
// case with a wrong or missed kind.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <cstring>
#include <map>
#include <set>

#include "bench/blind/drawn_points.hpp"

namespace twinrate::blind {
namespace {

struct Counts {
  int cases = 0, false_claims = 0, wrong = 0, exact = 0, missed = 0;
  std::map<std::string, int> verdicts;
};

bool holds(const std::vector<std::string>& list, const std::string& kind) {
  return std::find(list.begin(), list.end(), kind) != list.end();
}

void count(const PointCase& c, std::uint64_t seed, bool verbose, Counts& n) {
  std::set<std::string> named;
  for (const TracedEffect& e : c.result.effects) named.emplace(e.effect->kind());
  const bool wrong = std::any_of(named.begin(), named.end(), [&](const std::string& kind) {
    return !holds(c.truth, kind) && !holds(c.aliases, kind);
  });
  const bool missed = std::any_of(c.truth.begin(), c.truth.end(),
                                  [&](const std::string& kind) { return !named.count(kind); });
  const bool traced = c.result.verdict == "traced";
  // An alias group that contains the truth is right.
  const bool told = traced || (c.result.verdict == "ambiguous" && !c.aliases.empty());
  const bool silent = c.truth.empty() && c.result.verdict == "nothing_missing";
  ++n.cases, ++n.verdicts[c.result.verdict];
  n.wrong += wrong;
  n.false_claims += wrong && traced;
  n.missed += missed;
  n.exact += silent || (told && !wrong && !missed && !c.truth.empty());
  if (verbose && (wrong || missed))
    fmt::print("  {} {}, {}: {}, truth {}, named {}: {}\n", seed,
               kPointSets[static_cast<int>(c.set)], kSpoilt[static_cast<int>(c.spoilt)],
               c.result.verdict, c.truth, named, c.result.sentence);
}

void run(int cases, std::uint64_t first, int only, bool verbose) {
  fmt::print("{:17}{:10}{:>6}{:>7}{:>7}{:>7}{:>7}  verdicts\n", "set", "class", "cases", "false",
             "wrong", "exact", "missed");
  Counts all;
  for (int set = 0; set < 4; ++set) {
    if (only >= 0 && only < 4 && set != only) continue;
    for (int spoilt = 0; spoilt < 7; ++spoilt) {
      Counts n;
      for (int k = 0; k < cases; ++k) {
        const std::uint64_t seed =
            first + static_cast<std::uint64_t>(1000 * set + 100000 * spoilt + k);
        count(trace_points(PointSet(set), Spoilt(spoilt), seed), seed, verbose, n);
      }
      fmt::print("{:17}{:10}{:6}{:7}{:7}{:7}{:7}  {}\n", kPointSets[set], kSpoilt[spoilt], n.cases,
                 n.false_claims, n.wrong, n.exact, n.missed, n.verdicts);
      all.cases += n.cases, all.false_claims += n.false_claims, all.wrong += n.wrong;
    }
  }
  fmt::print("{} cases: {} false claims under traced, {} wrong kinds under any verdict\n",
             all.cases, all.false_claims, all.wrong);
}

}  // namespace
}  // namespace twinrate::blind

int main(int argc, char** argv) {
  const bool verbose = argc > 1 && std::strcmp(argv[argc - 1], "-v") == 0;
  const int cases = argc > 1 ? std::atoi(argv[1]) : 20;
  const std::uint64_t seed = argc > 2 ? std::strtoull(argv[2], nullptr, 10) : 1;
  const int only = argc > 3 && std::strcmp(argv[3], "-v") != 0 ? std::atoi(argv[3]) : -1;
  twinrate::blind::run(cases > 0 ? cases : 20, seed, only, verbose);
  return 0;
}
