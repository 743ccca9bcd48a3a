#include "estimator/registry.hpp"

#include "estimator/active_flux.hpp"
#include "estimator/backemf_printed.hpp"
#include "estimator/dq_ekf.hpp"
#include "estimator/eemf.hpp"
#include "estimator/ekf_disturbance.hpp"
#include "estimator/ekf_harmonic.hpp"
#include "estimator/ekf_sensorless.hpp"

namespace twinrate {
namespace {

class EkfSensorlessBuilder final : public FilterBuilder {
 public:
  void fields(FieldVisitor& f) override { tuning_.fields(f); }
  std::shared_ptr<Filter> build(const DriveConfig& config) const override {
    return std::make_shared<EkfSensorless>(config.machine, tuning_, config.estimator.prediction,
                                           config.estimator.covariance, config.T_s(),
                                           config.machine.n_p * config.omega_m_start());
  }

 private:
  EkfSensorlessParameters tuning_;
};

class EkfDisturbanceBuilder final : public FilterBuilder {
 public:
  void fields(FieldVisitor& f) override { tuning_.fields(f); }
  std::shared_ptr<Filter> build(const DriveConfig& config) const override {
    return std::make_shared<EkfDisturbance>(config.machine, tuning_, config.estimator.prediction,
                                            config.estimator.covariance, config.T_s());
  }

 private:
  EkfDisturbanceParameters tuning_;
};

// Filters of the salient machine: parameters, and where a flying start begins.
template <class Kind, class Parameters>
class SalientBuilder final : public FilterBuilder {
 public:
  void fields(FieldVisitor& f) override { tuning_.fields(f); }
  std::shared_ptr<Filter> build(const DriveConfig& config) const override {
    KnownStart start;
    if (config.start == Start::kFlying)
      start = {config.plant.theta_e_start, config.machine.n_p * config.omega_m_start()};
    return std::make_shared<Kind>(config.machine, tuning_, config.estimator.prediction,
                                  config.estimator.covariance, config.T_s(), start);
  }

 private:
  Parameters tuning_;
};

class EkfHarmonicBuilder final : public FilterBuilder {
 public:
  void fields(FieldVisitor& f) override { tuning_.fields(f); }
  std::shared_ptr<Filter> build(const DriveConfig& config) const override {
    return std::make_shared<EkfHarmonic>(config.machine, tuning_, config.estimator.prediction,
                                         config.estimator.covariance, config.T_s());
  }

 private:
  EkfHarmonicParameters tuning_;
};

template <class Builder>
std::unique_ptr<FilterBuilder> make() {
  return std::make_unique<Builder>();
}

struct Entry {
  const char* kind;
  std::unique_ptr<FilterBuilder> (*make_builder)();
};
constexpr Entry kEntries[] = {
    {"ekf_sensorless", make<EkfSensorlessBuilder>},
    {"ekf_disturbance", make<EkfDisturbanceBuilder>},
    {"ekf_harmonic", make<EkfHarmonicBuilder>},
    {"backemf_printed", make<SalientBuilder<BackEmfPrinted, BackEmfParameters>>},
    {"active_flux", make<SalientBuilder<ActiveFlux, ActiveFluxParameters>>},
    {"eemf", make<SalientBuilder<Eemf, EemfParameters>>},
    {"dq_ekf", make<SalientBuilder<DqEkf, DqEkfParameters>>},
};

}  // namespace

std::unique_ptr<FilterBuilder> filter_builder(std::string_view kind) {
  for (const Entry& entry : kEntries)
    if (entry.kind == kind) return entry.make_builder();
  return nullptr;
}

std::vector<std::string> filter_kinds() {
  std::vector<std::string> kinds;
  for (const Entry& entry : kEntries) kinds.emplace_back(entry.kind);
  return kinds;
}

}  // namespace twinrate
