// A record and the objects for a fit of chosen effects to it.
#pragma once
#include <algorithm>
#include <map>

#include "tests/support/effects.hpp"
#include "tests/trace/synthetic_drive.hpp"
#include "trace/keys.hpp"
#include "trace/noise.hpp"
#include "trace/thinning.hpp"
#include "trace/tracer.hpp"

namespace twinrate {

inline std::shared_ptr<Effect> effect_with(const char* kind, std::map<std::string, double> keys) {
  return test::effect_of(kind, std::move(keys), servo().facts());
}

inline std::vector<std::string> kinds_of(const Members& members) {
  std::vector<std::string> list;
  for (const auto& m : members) list.emplace_back(m->kind());
  std::sort(list.begin(), list.end());
  return list;
}

class FittedDrive {
 public:
  // The residual with `truth` is noise. `held_out`: for each row; empty: the blocks of the tracer.
  // `rows` of the log make a row.
  FittedDrive(const RawLog& raw, const Members& truth, const std::vector<char>& held_out = {},
              std::size_t rows = 1)
      : record_(thinned(make_record(raw, servo().machine.n_p, health_), rows, servo().machine.n_p)),
        equations_(record_, servo().facts()),
        moving_(moving_rows(equations_.record())),
        noisier_(add_noise(record_, servo().facts(), moving_, health_.i_lsb)),
        answered_(noisier_.answered, servo().facts()),
        readings_(noisier_.readings, servo().facts()),
        sampler_(record_, moving_,
                 held_out.empty() ? held_out_rows(record_, 0.25, servo().machine.n_p) : held_out),
        chain_(equations_, answered_, readings_, sampler_) {
    chain_.set_noise(NoiseFit()(chain_, chain_.residual({truth.begin(), truth.end()}), {}));
  }
  FittedDrive(const FittedDrive&) = delete;  // its members refer to each other

  const Chain& chain() const { return chain_; }
  // Scales the noise of the record.
  void scale_noise(double times) {
    NoiseModel noise = chain_.noise();
    for (double* scale : {&noise.scale_d, &noise.scale_q, &noise.scale_torque}) *scale *= times;
    chain_.set_noise(std::move(noise));
  }
  Fitter fitter() const { return {chain_, training_, held_out_}; }

 private:
  Health health_;
  Record record_;
  Equations equations_;
  std::vector<char> moving_;
  NoisierRecords noisier_;
  Equations answered_, readings_;
  Sampler sampler_;
  Chain chain_;
  Rows training_{sampler_, false}, held_out_{sampler_, true};
};

}  // namespace twinrate
