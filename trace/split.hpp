// The rows to which a claim is fitted, those that choose it, and those that judge it.
//
// Of 24 blocks of a record about 14 fit, 4 choose (they refuse a claim that lowers the error only
// on the fitted rows) and 6 judge. Judging rows enter no fit, no placing, no choice and no noise
// model: only the gate (trace/gate.hpp) and the reported errors read them. A block with a moment
// that is placed (a load step) fits instead: the others cannot date it.
//
// The blocks are even if a fourth of them has its share of the drive's activity, to a factor of
// two. Otherwise (a start of a quarter of a second in six) two thirds of a row's weight in a block
// are its time, a sixth is the square of its acceleration and a sixth that of its current. No block
// is shorter than a quarter of an even one, or than 250 rows.
#pragma once
#include <string>
#include <vector>

#include "trace/record.hpp"

namespace twinrate {

// Rows of one file in the record of the chain.
struct JudgedFile {
  std::string path;
  bool held_out = false;
  std::size_t rows = 0;
};
struct JudgedFiles {
  std::vector<JudgedFile> files;
  std::vector<int> of_row;  // file of each row of the chain's record
};

// Of each row, its block: 0 to 23, in order of time.
std::vector<std::size_t> blocks_of_rows(const Record& record, int n_p);
// Of each row: 1 if it judges. `share`: of the time; 0: none.
std::vector<char> held_out_rows(const Record& record, double share, int n_p);
// Of each row: 1 if it chooses, out of those that do not judge.
std::vector<char> choosing_rows(const Record& record, const std::vector<char>& judging, int n_p);
// Marks the rows as unusable.
void hide(const std::vector<char>& rows, Record& record);

}  // namespace twinrate
