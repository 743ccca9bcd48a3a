// The kinds of effects that a trace considers: those of the catalogue less what the user excludes.
#pragma once
#include <string>
#include <string_view>
#include <vector>

#include "trace/result.hpp"

namespace twinrate {

class Considered {
 public:
  Considered() = default;  // every kind
  // Kinds of the catalogue, in any order; a kind may be given twice.
  explicit Considered(std::vector<std::string> excluded);

  bool operator()(std::string_view kind) const;
  std::vector<std::string> kinds() const;  // of the catalogue
  std::vector<std::string> of(std::vector<std::string> kinds) const;
  const std::vector<std::string>& excluded() const { return excluded_; }

 private:
  std::vector<std::string> excluded_;  // sorted
};

// Removes the excluded kinds from aliases and lists, before the verdict. An ambiguity with excluded
// kinds alone becomes a line about the data. The result lists the kinds as excluded.
void leave_out_excluded(const Considered& considered, TraceResult& r);
// Names the excluded kinds at the end of the sentence, except in an `inconsistent` result, for
// which no effect was looked for.
void tell_excluded(const Considered& considered, TraceResult& r);

}  // namespace twinrate
