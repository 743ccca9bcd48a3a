// Filters by their kind. A new filter is a header, a source file and one line in registry.cpp.
#pragma once
#include <memory>
#include <string>
#include <vector>

#include "core/drive_config.hpp"
#include "estimator/filter.hpp"

namespace twinrate {

// The keys of one kind of filter ([estimator.KIND]), and how to make it from them.
class FilterBuilder {
 public:
  virtual ~FilterBuilder() = default;
  virtual void fields(FieldVisitor& f) = 0;
  // Defaults for the machine of the drive file (estimator/scaled_tuning.hpp), before fields() reads.
  virtual void scale(const DriveConfig& config) = 0;
  virtual std::shared_ptr<Filter> build(const DriveConfig& config) const = 0;
};

// Null if there is no such kind.
std::unique_ptr<FilterBuilder> filter_builder(std::string_view kind);
// With the defaults of this drive.
std::unique_ptr<FilterBuilder> filter_builder(std::string_view kind, const DriveConfig& drive);
std::vector<std::string> filter_kinds();

}  // namespace twinrate
