// Controllers by their kind; a new controller is one file and one line here.
#include "controller/foc.hpp"

namespace twinrate {
namespace {

class FocBuilder final : public ControllerBuilder {
 public:
  void fields(FieldVisitor& f) override { parameters_.fields(f); }
  std::unique_ptr<Controller> build(const DriveConfig& config) const override {
    return std::make_unique<Foc>(config, parameters_);
  }

 private:
  FocParameters parameters_;
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
};

}  // namespace

std::unique_ptr<ControllerBuilder> controller_builder(std::string_view kind) {
  for (const Entry& entry : kEntries)
    if (entry.kind == kind) return entry.make_builder();
  return nullptr;
}

std::vector<std::string> controller_kinds() {
  std::vector<std::string> kinds;
  for (const Entry& entry : kEntries) kinds.emplace_back(entry.kind);
  return kinds;
}

}  // namespace twinrate
