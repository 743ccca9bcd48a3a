#include "estimator/make_filter.hpp"

#include <fmt/format.h>

namespace twinrate {

std::shared_ptr<const Filter> make_filter(Config& config) {
  const std::string& kind = config.drive().estimator.kind;
  const auto builder = filter_builder(kind);
  if (!builder)
    throw BadInput(fmt::format("{}: estimator.kind: one of {} allowed, found {}",
                               config.where("estimator.kind"), fmt::join(filter_kinds(), ", "),
                               kind));
  config.read_table("estimator." + kind, [&](FieldVisitor& f) { builder->fields(f); });
  return builder->build(config.drive());
}

}  // namespace twinrate
