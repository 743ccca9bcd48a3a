#include "trace/problem.hpp"

#include "trace/parallel.hpp"
#include "trace/split.hpp"
#include "trace/thinning.hpp"

namespace twinrate {
namespace {

Record without(const std::vector<char>& rows, Record record) {
  hide(rows, record);
  return record;
}

}  // namespace

DriveProblem::Thinned::Thinned(const DriveProblem& of, const DriveFacts& facts,
                               const Effects& known, const Considered& considered) {
  together({
      [&] {
        record = of.thin(of.seen_rows_);
        equations.emplace(record, facts, known, considered);
      },
      [&] {
        answered_record = of.thin(of.noisier_.answered);
        answered.emplace(answered_record, facts, known);
      },
      [&] {
        readings_record = of.thin(of.noisier_.readings);
        readings.emplace(readings_record, facts, known);
      },
      [&] { all_rows = of.thin(of.whole_); },
  });
}

DriveProblem::DriveProblem(const Record& whole, const std::vector<char>& judging,
                           const DriveFacts& facts, const Effects& known,
                           const Considered& considered, double i_lsb)
    : whole_(whole),
      n_p_(facts.machine.n_p),
      rows_(rows_as_one(whole.T_s)),
      seen_rows_(without(judging, whole)),
      noisier_(add_noise(seen_rows_, facts, moving_rows(seen_rows_), i_lsb)),
      thinned_(*this, facts, known, considered),
      sampler_(thinned_.record, moving_rows(thinned_.record),
               thinned(choosing_rows(whole, judging, n_p_), whole, rows_)),
      sampler_of_all_(thinned_.all_rows, moving_rows(thinned_.all_rows),
                      thinned(judging, whole, rows_)),
      seen_(*thinned_.equations, *thinned_.answered, *thinned_.readings, sampler_),
      all_(*thinned_.equations, *thinned_.answered, *thinned_.readings, sampler_of_all_) {
  if (!(seen_rows_.angle.lsb > 0)) return;
  for (Chain* chain : {&seen_, &all_})
    chain->set_moved_counts([this] { return thin(with_moved_counts(seen_rows_)); });
}

void DriveProblem::set_noise(const NoiseModel& noise) {
  seen_.set_noise(noise);
  all_.set_noise(noise);
}

void DriveProblem::stop_when(const std::function<bool()>& stop) {
  seen_.stop_when(stop);
  all_.stop_when(stop);
}

}  // namespace twinrate
