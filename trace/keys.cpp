#include "trace/keys.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "model/drive_facts.hpp"
#include "model/fields.hpp"

namespace twinrate {
namespace {

// Visits the numbers of a field list; other fields are skipped.
class NumberVisitor : public FieldVisitor {
 public:
  void number(const char* key, double& value, double lo, double hi, const char*,
              Presence) override {
    visit(key, value, lo, hi, false, "");
  }
  void integer(const char* key, int& value, int lo, int hi, const char*, Presence) override {
    double number = value;
    visit(key, number, lo, hi, true, "");
    value = static_cast<int>(std::lround(number));
  }
  void choice(const char* key, int& index, std::span<const char* const> names,
              const char*) override {
    double number = index;
    visit(key, number, 0, static_cast<double>(names.size()) - 1, true,
          names[static_cast<std::size_t>(index)]);
    index = static_cast<int>(std::lround(number));
  }
  void boolean(const char*, bool&, const char*) override {}
  void text(const char*, std::string&, const char*) override {}
  void numbers(const char*, std::span<double>, double, double, const char*) override {}
  void integers(const char*, std::vector<int>&, int, int, std::size_t, const char*) override {}
  void profile(const char*, Profile&, double, double, const char*) override {}
  void choice_profile(const char*, Profile&, std::span<const char* const>, const char*) override {}
  void table(const char*, const std::function<void(FieldVisitor&)>& fields) override {
    fields(*this);
  }

 protected:
  virtual void visit(const std::string& key, double& value, double lo, double hi, bool whole,
                     const std::string& text) = 0;
};

class Lister final : public NumberVisitor {
 public:
  std::vector<NumericKey> keys;

 private:
  void visit(const std::string& key, double& value, double lo, double hi, bool whole,
             const std::string& text) override {
    keys.push_back({key, value, lo, hi, whole, text});
  }
};

class Setter final : public NumberVisitor {
 public:
  Setter(std::string key, double value) : key_(std::move(key)), value_(value) {}
  bool found = false, inside = true;

 private:
  void visit(const std::string& key, double& value, double lo, double hi, bool,
             const std::string&) override {
    if (key != key_) return;
    found = true;
    inside = value_ >= lo && value_ <= hi;
    value = std::clamp(value_, lo, hi);
  }
  std::string key_;
  double value_;
};

}  // namespace

std::vector<NumericKey> numeric_keys(const Effect& effect) {
  Lister lister;
  effect.clone()->fields(lister);
  return lister.keys;
}

std::vector<double> key_values(const Effect& effect) {
  std::vector<double> values;
  for (const NumericKey& key : numeric_keys(effect)) values.push_back(key.value);
  return values;
}

bool has_key(const Effect& effect, const std::string& key) {
  const std::vector<NumericKey> keys = numeric_keys(effect);
  return std::any_of(keys.begin(), keys.end(), [&](const NumericKey& k) { return k.key == key; });
}

double get_key(const Effect& effect, const std::string& key) {
  for (const NumericKey& k : numeric_keys(effect))
    if (k.key == key) return k.value;
  throw std::logic_error(std::string(effect.kind()) + " has no numeric key " + key);
}

bool set_key(Effect& effect, const std::string& key, double value) {
  Setter setter(key, value);
  effect.fields(setter);
  if (!setter.found)
    throw std::logic_error(std::string(effect.kind()) + " has no numeric key " + key);
  return setter.inside;
}

OtherName read_as(const Effect& effect, const Traits::Reading& reading, const DriveFacts& facts) {
  OtherName other{.effect = make_effect(reading.kind)};
  for (const Traits::KeyPair& pair : reading.keys) {
    const double volts =
        pair.scale == Traits::KeyPair::kPerSwitchedVolt ? facts.v_dc * facts.f_pwm : 1;
    other.fits = set_key(*other.effect, pair.to, get_key(effect, pair.from) / volts) && other.fits;
  }
  return other;
}

bool within_ranges(const Effect& effect) {
  for (const NumericKey& k : numeric_keys(effect))
    if (!std::isfinite(k.value) || k.value < k.lo || k.value > k.hi) return false;
  return true;
}

}  // namespace twinrate
