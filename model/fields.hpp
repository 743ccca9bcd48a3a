// One list per parameter struct: reading, range check, writing back and the reference page all walk
// it.
//
// A struct declares `void fields(FieldVisitor& f)` and names each member once with key (unit
// included), range and a one-line meaning. Visitors: the TOML reader and writer of core/config, the
// reference page.
#pragma once
#include <functional>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

#include "model/profile.hpp"

namespace twinrate {

enum class Presence { kRequired, kOptional };

template <class T>
concept Enumeration = std::is_enum_v<T>;

class FieldVisitor {
 public:
  virtual ~FieldVisitor() = default;
  // Number with its allowed closed range, both ends given in the key's unit.
  virtual void number(const char* key, double& value, double lo, double hi, const char* meaning,
                      Presence presence = Presence::kOptional) = 0;
  virtual void integer(const char* key, int& value, int lo, int hi, const char* meaning,
                       Presence presence = Presence::kOptional) = 0;
  virtual void boolean(const char* key, bool& value, const char* meaning) = 0;
  virtual void text(const char* key, std::string& value, const char* meaning) = 0;
  // One of `names`; `index` is the position.
  virtual void choice(const char* key, int& index, std::span<const char* const> names,
                      const char* meaning) = 0;
  // Exactly `values.size()` numbers, e.g. the diagonal of a covariance.
  virtual void numbers(const char* key, std::span<double> values, double lo, double hi,
                       const char* meaning) = 0;
  // Up to `most` whole numbers.
  virtual void integers(const char* key, std::vector<int>& values, int lo, int hi, std::size_t most,
                        const char* meaning) = 0;
  // A number, or a list of [t_s, value] pairs (see Profile).
  virtual void profile(const char* key, Profile& value, double lo, double hi,
                       const char* meaning) = 0;
  // One of `names`, or a list of [t_s, name] pairs; the profile holds positions in `names`.
  virtual void choice_profile(const char* key, Profile& indices, std::span<const char* const> names,
                              const char* meaning) = 0;
  // A nested table.
  virtual void table(const char* key, const std::function<void(FieldVisitor&)>& fields) = 0;

  // An enumeration that counts from 0; `names` in the order of its enumerators.
  template <Enumeration Enum>
  void choice(const char* key, Enum& value, std::span<const char* const> names,
              const char* meaning) {
    int index = static_cast<int>(value);
    choice(key, index, names, meaning);
    value = static_cast<Enum>(index);
  }
};

// "amplitude_Nm" -> {"amplitude", "Nm"}; unit "1" if the key has none ("order": "per_rev").
struct NameAndUnit {
  std::string name, unit;
};
NameAndUnit split_unit(const std::string& key);

}  // namespace twinrate
