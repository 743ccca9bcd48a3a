// The values of a motor's data sheet, in the units and conventions of the sheet.
#pragma once
#include <iosfwd>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace twinrate {

// One value that a sheet can give. Without `choices` it is a number from `lo` to `hi`.
struct SheetKey {
  const char* key;  // unit included
  const char* meaning;
  double lo = 0, hi = 0;
  bool whole = false;
  std::span<const char* const> choices = {};
};

// Convention of an EMF constant: the voltage between two lines or of one phase, its peak or its rms
// value.
enum class EmfConvention : int { kLinePeak = 0, kLineRms, kPhasePeak, kPhaseRms };
inline constexpr const char* kEmfConventionNames[] = {"line_peak", "line_rms", "phase_peak",
                                                      "phase_rms"};
// Convention of a torque constant: Nm per ampere of the peak or of the rms phase current, or of the
// direct current through two phases in block commutation.
enum class CurrentConvention : int { kPeak = 0, kRms, kBlock };
inline constexpr const char* kCurrentConventionNames[] = {"peak", "rms", "block"};

class Sheet {
 public:
  // All keys, in the order in which ask() asks for them.
  static const std::vector<SheetKey>& keys();

  // `value` is a number in the unit of the key, or a number with a unit: "5.35 oz-in/A" for
  // kt_Nm_A. Throws BadInput: unknown key or unit, not a number, out of range, no such choice,
  // given twice.
  void set(const std::string& key, const std::string& value);

  bool has(const std::string& key) const { return values_.count(key) > 0; }
  // The number, or the index of the choice; none if the sheet does not give it.
  std::optional<double> operator[](const std::string& key) const;
  // Conversions of the values that were given in another unit than that of the key.
  const std::vector<std::string>& conversions() const { return conversions_; }

 private:
  std::map<std::string, double> values_;
  std::vector<std::string> conversions_;
};

// Reads "key=value" texts. Throws BadInput.
Sheet read_sheet(const std::vector<std::string>& pairs);

// Asks for each key on `out`; an empty answer leaves it out, a bad one is reported and asked again.
// The convention of a constant is only asked if the constant is given. Throws BadInput at the end
// of `in`.
Sheet ask_for_sheet(std::istream& in, std::ostream& out);

}  // namespace twinrate
