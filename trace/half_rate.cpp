#include "trace/half_rate.hpp"

#include <cmath>

#include "trace/thinning.hpp"

namespace twinrate {

HalfRate::HalfRate(const Record& whole, const NoisierRecords& noisier, std::size_t rows,
                   const DriveFacts& facts, const Effects& known, const Effects& effects,
                   const NoiseModel& scales)
    : record_(thinned(whole, rows, facts.machine.n_p)),
      answered_record_(thinned(noisier.answered, rows, facts.machine.n_p)),
      readings_record_(thinned(noisier.readings, rows, facts.machine.n_p)),
      equations_(record_, facts, known),
      answered_(answered_record_, facts, known),
      readings_(readings_record_, facts, known),
      sampler_(record_, moving_rows(record_), std::vector<char>(record_.size(), 0)),
      chain_(equations_, answered_, readings_, sampler_) {
  const Sampled left = chain_.noiseless(effects);
  NoiseModel noise{.d = {},
                   .q = {},
                   .torque = {},
                   .scale_d = scales.scale_d,
                   .scale_q = scales.scale_q,
                   .scale_torque = scales.scale_torque};
  if (left.d.size()) noise.d = Whitener(left.d, sampler_.electrical());
  if (left.q.size()) noise.q = Whitener(left.q, sampler_.electrical());
  if (left.torque.size()) {
    const Runs& runs = sampler_.torque();
    const AngleNoise angle = AngleNoise::of(left.torque, runs, sampler_.decimation() * record_.T_s);
    const double count = static_cast<double>(left.torque.size());
    noise.torque = Whitener(angle(left.torque, runs), runs, angle,
                            std::sqrt(left.torque.squaredNorm() / count));
    noise.sensors =
        AngleNoise::of(chain_.residual({}).noise_torque, runs, sampler_.decimation() * record_.T_s);
  }
  chain_.set_noise(std::move(noise));
}

}  // namespace twinrate
