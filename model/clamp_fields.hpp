// Fields into their ranges: for defaults that follow from a formula.
//
// A default beyond the range of its key would be written to a resolved drive file that no program
// then reads.
#pragma once
#include <algorithm>

#include "model/fields.hpp"

namespace twinrate {

class ClampFields final : public FieldVisitor {
 public:
  void number(const char* /*key*/, double& value, double lo, double hi, const char* /*meaning*/,
              Presence /*presence*/) override {
    value = std::clamp(value, lo, hi);
  }
  void integer(const char* /*key*/, int& value, int lo, int hi, const char* /*meaning*/,
               Presence /*presence*/) override {
    value = std::clamp(value, lo, hi);
  }
  void numbers(const char* /*key*/, std::span<double> values, double lo, double hi,
               const char* /*meaning*/) override {
    for (double& value : values) value = std::clamp(value, lo, hi);
  }
  void table(const char* /*key*/, const std::function<void(FieldVisitor&)>& fields) override {
    fields(*this);
  }
  void boolean(const char* /*key*/, bool& /*value*/, const char* /*meaning*/) override {}
  void text(const char* /*key*/, std::string& /*value*/, const char* /*meaning*/) override {}
  void choice(const char* /*key*/, int& /*index*/, std::span<const char* const> /*names*/,
              const char* /*meaning*/) override {}
  void integers(const char* /*key*/, std::vector<int>& /*values*/, int /*lo*/, int /*hi*/,
                std::size_t /*most*/, const char* /*meaning*/) override {}
  void profile(const char* /*key*/, Profile& /*value*/, double /*lo*/, double /*hi*/,
               const char* /*meaning*/) override {}
  void choice_profile(const char* /*key*/, Profile& /*indices*/,
                      std::span<const char* const> /*names*/, const char* /*meaning*/) override {}
};

}  // namespace twinrate
