// A drive log as the search and the gate use it: its rows at the tracer's rate, its equations, the
// same with sensor noise added, and the judging rows kept apart.
#pragma once
#include <optional>

#include "trace/chain.hpp"
#include "trace/noise.hpp"
#include "trace/thinning.hpp"

namespace twinrate {

class DriveProblem {
 public:
  // `judging`: of each row, whether it judges. `known`: effects of the drive file. `i_lsb`: A, step
  // of the current converter.
  DriveProblem(const Record& whole, const std::vector<char>& judging, const DriveFacts& facts,
               const Effects& known, const Considered& considered, double i_lsb);
  DriveProblem(const DriveProblem&) = delete;
  DriveProblem& operator=(const DriveProblem&) = delete;

  const DriveFacts& facts() const { return thinned_.equations->facts(); }
  const Record& whole() const { return whole_; }
  std::size_t rows() const { return rows_; }  // of the log in one row of the tracer
  const NoisierRecords& noisier() const { return noisier_; }
  const Record& all_rows() const { return thinned_.all_rows; }

  Chain& seen() { return seen_; }  // of the rows that do not judge
  const Chain& seen() const { return seen_; }
  const Chain& all() const { return all_; }
  // Gives both chains one noise model: a new one, or that of the rows that do not judge.
  void set_noise(const NoiseModel& noise);
  void share_noise() { all_.set_noise(seen_.noise()); }
  void stop_when(const std::function<bool()>& stop);

 private:
  // The rows at the tracer's rate, and the equations of those that do not judge.
  struct Thinned {
    Thinned(const DriveProblem& of, const DriveFacts& facts, const Effects& known,
            const Considered& considered);
    Record record, answered_record, readings_record, all_rows;
    std::optional<Equations> equations, answered, readings;
  };
  Record thin(const Record& record) const { return thinned(record, rows_, n_p_); }

  const Record& whole_;
  int n_p_;
  std::size_t rows_;
  Record seen_rows_;  // at the log's rate, without the judging rows
  NoisierRecords noisier_;
  Thinned thinned_;
  Sampler sampler_, sampler_of_all_;
  Chain seen_, all_;
};

}  // namespace twinrate
