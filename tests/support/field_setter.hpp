// A FieldVisitor that sets named values and records the declared keys.
#pragma once
#include <map>
#include <set>
#include <string>

#include "model/fields.hpp"

namespace twinrate::test {

class FieldSetter : public FieldVisitor {
 public:
  explicit FieldSetter(std::map<std::string, double> values = {}) : values_(std::move(values)) {}

  void number(const char* key, double& value, double lo, double hi, const char*,
              Presence presence) override {
    note(key, presence);
    const auto found = values_.find(key);
    if (found != values_.end()) value = found->second;
    in_range_ = in_range_ && (value >= lo && value <= hi);
    seen_values_[key] = value;
  }
  void integer(const char* key, int& value, int lo, int hi, const char*,
               Presence presence) override {
    note(key, presence);
    const auto found = values_.find(key);
    if (found != values_.end()) value = static_cast<int>(found->second);
    in_range_ = in_range_ && (value >= lo && value <= hi);
    seen_values_[key] = value;
  }
  void boolean(const char* key, bool&, const char*) override { note(key, Presence::kOptional); }
  void text(const char* key, std::string&, const char*) override { note(key, Presence::kOptional); }
  void choice(const char* key, int& index, std::span<const char* const>, const char*) override {
    note(key, Presence::kOptional);
    const auto found = values_.find(key);
    if (found != values_.end()) index = static_cast<int>(found->second);
  }
  void numbers(const char* key, std::span<double>, double, double, const char*) override {
    note(key, Presence::kOptional);
  }
  void integers(const char* key, std::vector<int>&, int, int, std::size_t, const char*) override {
    note(key, Presence::kOptional);
  }
  void profile(const char* key, Profile&, double, double, const char*) override {
    note(key, Presence::kOptional);
  }
  void choice_profile(const char* key, Profile&, std::span<const char* const>,
                      const char*) override {
    note(key, Presence::kOptional);
  }
  void table(const char*, const std::function<void(FieldVisitor&)>& fields) override {
    fields(*this);
  }

  const std::set<std::string>& keys() const { return keys_; }
  const std::set<std::string>& required() const { return required_; }
  const std::map<std::string, double>& seen_values() const { return seen_values_; }
  bool in_range() const { return in_range_; }

 private:
  void note(const char* key, Presence presence) {
    keys_.insert(key);
    if (presence == Presence::kRequired) required_.insert(key);
  }
  std::map<std::string, double> values_, seen_values_;
  std::set<std::string> keys_, required_;
  bool in_range_ = true;
};

}  // namespace twinrate::test
