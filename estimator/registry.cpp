#include "estimator/registry.hpp"

#include "estimator/backemf_printed.hpp"
#include "estimator/scaled_tuning.hpp"
#include "model/clamp_fields.hpp"

namespace twinrate {
namespace {

// Angle and speed at the start: known for a flying start, else 0.
KnownStart known_start(const DriveConfig& config) {
  if (config.start != Start::kFlying) return {};
  return {config.plant.theta_e_start, config.machine.n_p * config.omega_m_start()};
}

// Parameters of a kind, and the start that it takes: none, the speed, or angle and speed.
template <class Kind, class Parameters>
class Builder final : public FilterBuilder {
 public:
  void fields(FieldVisitor& f) override { tuning_.fields(f); }
  void scale(const DriveConfig& c) override {
    twinrate::scale(tuning_, per_unit(c.machine, c.inverter.v_dc, c.T_s()), c.machine.J, c.T_s());
  }
  std::shared_ptr<Filter> build(const DriveConfig& config) const override {
    const auto make = [&](auto... start) {
      return std::make_shared<Kind>(config.machine, tuning_, config.estimator.prediction,
                                    config.estimator.covariance, config.T_s(), start...);
    };
    const KnownStart start = known_start(config);
    if constexpr (std::is_same_v<Kind, EkfJointKind>)
      return Kind::make(config.machine, tuning_, config.estimator.prediction,
                        config.estimator.covariance, config.T_s(), start);
    else if constexpr (takes<KnownStart>)
      return make(start);
    else if constexpr (takes<double>)
      return make(start.omega_e);
    else
      return make();
  }

 private:
  template <class StartOf>
  static constexpr bool takes =
      std::is_constructible_v<Kind, MachineParameters, Parameters, Prediction, CovarianceForm,
                              double, StartOf>;
  Parameters tuning_;
};

template <class Kind, class Parameters>
std::unique_ptr<FilterBuilder> make() {
  return std::make_unique<Builder<Kind, Parameters>>();
}

struct Entry {
  const char* kind;
  std::unique_ptr<FilterBuilder> (*make_builder)();
};
constexpr Entry kEntries[] = {
    {"ekf_sensorless", make<EkfSensorless, EkfSensorlessParameters>},
    {"ekf_disturbance", make<EkfDisturbance, EkfDisturbanceParameters>},
    {"ekf_harmonic", make<EkfHarmonic, EkfHarmonicParameters>},
    {"backemf_printed", make<BackEmfPrinted, BackEmfParameters>},
    {"active_flux", make<ActiveFlux, ActiveFluxParameters>},
    {"eemf", make<Eemf, EemfParameters>},
    {"dq_ekf", make<DqEkf, DqEkfParameters>},
    {"ekf_joint", make<EkfJointKind, EkfJointParameters>},
};

}  // namespace

std::unique_ptr<FilterBuilder> filter_builder(std::string_view kind) {
  for (const Entry& entry : kEntries)
    if (entry.kind == kind) return entry.make_builder();
  return nullptr;
}

std::unique_ptr<FilterBuilder> filter_builder(std::string_view kind, const DriveConfig& drive) {
  auto builder = filter_builder(kind);
  if (!builder) return nullptr;
  builder->scale(drive);
  ClampFields into_their_ranges;
  builder->fields(into_their_ranges);
  return builder;
}

std::vector<std::string> filter_kinds() {
  std::vector<std::string> kinds;
  for (const Entry& entry : kEntries) kinds.emplace_back(entry.kind);
  return kinds;
}

}  // namespace twinrate
