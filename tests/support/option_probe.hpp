// What one option of a drive file does, where one pairing of filter, controller and start reads it.
//
// The option takes other values of its range, one at a time, as --set would:
//
//   changes    a tick of the closed loop, or a warning of the check, differs from the run without it
//   refused    one line that names the option (loop/unused_keys.hpp), whatever the value
//   elsewhere  it acts outside the loop: over the bus, on a page, on a real drive (acts_elsewhere)
//   silent     none of these: a defect
//   error      an exception that is no BadInput, or a refusal of several lines
//
// An option that needs a situation (a fault, a loss of synchronism, a second speed) is tried in it,
// too: situations(). What a pairing that is lost early never reaches is tried from a start at speed and on
// the machine without saliency: variants_of().
#pragma once
#include <string>
#include <vector>

#include "core/field_list.hpp"
#include "tests/support/drives.hpp"

namespace twinrate::test {

struct Pairing {
  std::string preset, estimator, controller, start;
};

struct Option {
  std::string key;               // "estimator.prediction"
  FieldRow row;                  // range and the value that the pairing has
  std::vector<std::string> set;  // other values, as TOML
};

enum class OptionAnswer { kChanges, kRefused, kElsewhere, kSilent, kError };

struct OptionProbe {
  OptionAnswer answer = OptionAnswer::kSilent;
  std::string why;   // the value that changed it, the refusal, or where it acts
  std::string with;  // what the run has beyond that of the pairing where it acts, as --set
};

// Every key of the reference page but `name`, `preset`, `start`, both kinds, and those of [[effect]].
std::vector<Option> options_of(const Pairing& pairing);

// Runs of one pairing; keeps the runs without the option.
class OptionProber {
 public:
  explicit OptionProber(Pairing pairing);
  ~OptionProber();
  OptionProbe probe(const Option& option);

 private:
  struct Runs;
  Pairing pairing_;
  std::unique_ptr<Runs> runs_;
};

}  // namespace twinrate::test
