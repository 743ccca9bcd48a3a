// Which rows a claim is fitted to, which choose it, and which judge it.
//
// Of 24 blocks of a record about 14 fit, 4 choose (they refuse what lowers the error only where it
// was fitted) and 6 judge. Rows that judge enter no fit, no placing, no choice and no noise model:
// only the gate (trace/gate.hpp) and the reported errors read them. A block with a moment that is
// placed (a load step) fits instead: the others cannot date it.
//
// The blocks are even where a fourth of them sees its share of what the drive does, to a factor of
// two. Elsewhere (a start of a quarter of a second in six) two thirds of a row's weight in a block
// are its time, a sixth the square of the acceleration and a sixth that of the current in it; no
// block is shorter than a quarter of an even one, or than 250 rows.
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
  std::vector<int> of_row;  // of each row of the chain's record: which file
};

// Of each row, its block: 0 to 23, in order of time.
std::vector<std::size_t> blocks_of_rows(const Record& record, int n_p);
// Of each row: 1 where it judges. `share`: of the time; 0: none.
std::vector<char> held_out_rows(const Record& record, double share, int n_p);
// Of each row: 1 where it chooses, out of those that do not judge.
std::vector<char> choosing_rows(const Record& record, const std::vector<char>& judging, int n_p);
// Marks the rows as ones that cannot be used.
void hide(const std::vector<char>& rows, Record& record);

}  // namespace twinrate
