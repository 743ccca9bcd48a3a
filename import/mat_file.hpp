// Reads MATLAB files of level 5 (save -v6 and -v7), as described in "MAT-File Format", MathWorks.
//
// The reader is meant for files of unknown origin: every length is checked against the bytes that
// are there, and packed variables are unpacked up to kMaxMatBytes in total. Sparse arrays, objects
// and function handles are left out. A file of level 7.3 is HDF5 and is refused.
#pragma once
#include <cstdint>
#include <string>
#include <vector>

namespace twinrate {

inline constexpr std::size_t kMaxMatBytes = std::size_t{1} << 30;

struct MatVariable {
  std::string name;
  enum class Kind { kNumbers, kText, kCells, kStruct, kOther } kind = Kind::kOther;
  std::size_t rows = 0, columns = 0;  // matrix(row, column), column by column
  std::vector<double> numbers;        // kNumbers
  std::vector<std::int64_t> wholes;   // kNumbers of class int64 (exact), else empty
  std::string text;                   // kText: bytes, row by row of a single row
  std::vector<MatVariable> parts;     // kCells in order; kStruct (1 x 1): its fields, with names
};

// The variables of the file. Throws BadInput, one line: no such file, another format, damaged,
// larger than kMaxMatBytes.
std::vector<MatVariable> read_mat(const std::string& path);

// A MATLAB file as a table: its real vectors of the most frequent length, with the fields of structs
// as STRUCT.FIELD and the columns of a matrix as NAME_1, NAME_2.
struct MatColumn {
  std::string name;
  std::vector<double> values;
};
struct MatTable {
  std::vector<MatColumn> columns;
  std::size_t rows = 0;
};
// Throws BadInput as read_mat, and if there is no vector of two numbers or more.
MatTable read_mat_table(const std::string& path);

}  // namespace twinrate
