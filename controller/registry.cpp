// Controllers by their kind; a new controller is one file and one line here.
#include <fmt/ranges.h>

#include "controller/foc.hpp"
#include "controller/lqr.hpp"
#include "controller/scaled_tuning.hpp"
#include "controller/watched.hpp"
#include "core/config.hpp"
#include "model/clamp_fields.hpp"

namespace twinrate {
namespace {

// Only the estimate can be lost.
template <class Parameters>
std::unique_ptr<Controller> watched(std::unique_ptr<Controller> controller,
                                    const DriveConfig& config, const Parameters& p) {
  if (!p.synchronism.watch || config.controller.angle_source != AngleSource::kEstimate)
    return controller;
  const WatchParameters watch{.synchronism = p.synchronism, .startup = p.startup, .i_max = p.i_max};
  return std::make_unique<Watched>(std::move(controller), config, watch);
}

class FocBuilder final : public ControllerBuilder {
 public:
  void fields(FieldVisitor& f) override { parameters_.fields(f); }
  void scale(const DriveConfig& config) override { twinrate::scale(parameters_, config); }
  std::unique_ptr<Controller> build(const DriveConfig& config) const override {
    return watched(std::make_unique<Foc>(config, parameters_), config, parameters_);
  }

 private:
  FocParameters parameters_;
};

class LqrBuilder final : public ControllerBuilder {
 public:
  void fields(FieldVisitor& f) override { parameters_.fields(f); }
  void scale(const DriveConfig& config) override { twinrate::scale(parameters_, config); }
  std::unique_ptr<Controller> build(const DriveConfig& config) const override {
    const LqrDesign design =
        design_lqr(config.machine, config.inverter.v_dc, config.T_s(), parameters_.design);
    for (const AxisDesign* axis : {&design.d, &design.q})
      if (!axis->complaints.empty())
        throw BadInput(fmt::format("controller.lqr: {} axis: {}", axis == &design.d ? "d" : "q",
                                   fmt::join(axis->complaints, "; ")));
    return watched(std::make_unique<Lqr>(config, parameters_, design), config, parameters_);
  }

 private:
  LqrParameters parameters_;
};

template <class Builder>
std::unique_ptr<ControllerBuilder> make() {
  return std::make_unique<Builder>();
}

struct Entry {
  const char* kind;
  std::unique_ptr<ControllerBuilder> (*make_builder)();
};
constexpr Entry kEntries[] = {
    {"foc", make<FocBuilder>},
    {"lqr", make<LqrBuilder>},
};

}  // namespace

std::unique_ptr<ControllerBuilder> controller_builder(std::string_view kind) {
  for (const Entry& entry : kEntries)
    if (entry.kind == kind) return entry.make_builder();
  return nullptr;
}

std::unique_ptr<ControllerBuilder> controller_builder(std::string_view kind,
                                                      const DriveConfig& drive) {
  auto builder = controller_builder(kind);
  if (!builder) return nullptr;
  builder->scale(drive);
  ClampFields into_their_ranges;
  builder->fields(into_their_ranges);
  return builder;
}

std::vector<std::string> controller_kinds() {
  std::vector<std::string> kinds;
  for (const Entry& entry : kEntries) kinds.emplace_back(entry.kind);
  return kinds;
}

}  // namespace twinrate
