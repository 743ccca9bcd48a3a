#include "controller/make_controller.hpp"

#include <fmt/format.h>

#include "controller/guarded.hpp"

namespace twinrate {

std::unique_ptr<Controller> make_controller(Config& config, Begin begin) {
  const std::string& kind = config.drive().controller.kind;
  const auto builder = controller_builder(kind, config.drive());
  if (!builder)
    throw BadInput(fmt::format("{}: controller.kind: one of {} allowed, found {}",
                               config.where("controller.kind"), fmt::join(controller_kinds(), ", "),
                               kind));
  config.read_table("controller." + kind, [&](FieldVisitor& f) { builder->fields(f); });
  DriveConfig drive = config.drive();
  if (begin == Begin::kAfterReset)
    drive.start =
        drive.controller.angle_source == AngleSource::kEstimate ? Start::kAlignIf : Start::kAligned;
  return std::make_unique<Guarded>(builder->build(drive));
}

}  // namespace twinrate
