#include "trace/problem.hpp"

#include "trace/split.hpp"
#include "trace/thinning.hpp"

namespace twinrate {
namespace {

Record without(const std::vector<char>& rows, Record record) {
  hide(rows, record);
  return record;
}

}  // namespace

DriveProblem::DriveProblem(const Record& whole, const std::vector<char>& judging,
                           const DriveFacts& facts, const Effects& known,
                           const Considered& considered, double i_lsb)
    : whole_(whole),
      n_p_(facts.machine.n_p),
      rows_(rows_as_one(whole.T_s)),
      seen_rows_(without(judging, whole)),
      noisier_(add_noise(seen_rows_, facts, moving_rows(seen_rows_), i_lsb)),
      record_(thin(seen_rows_)),
      answered_record_(thin(noisier_.answered)),
      readings_record_(thin(noisier_.readings)),
      all_rows_(thin(whole)),
      equations_(record_, facts, known, considered),
      answered_(answered_record_, facts, known),
      readings_(readings_record_, facts, known),
      sampler_(record_, moving_rows(record_),
               thinned(choosing_rows(whole, judging, n_p_), whole, rows_)),
      sampler_of_all_(all_rows_, moving_rows(all_rows_), thinned(judging, whole, rows_)),
      seen_(equations_, answered_, readings_, sampler_),
      all_(equations_, answered_, readings_, sampler_of_all_) {
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
