// A CSV is read block by block (256 KiB); records across the border of two blocks are complete.
#include "import/csv.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>
#include <zlib.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>

#include "core/config.hpp"
#include "model/random.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;

class Csv : public testing::Test {
 protected:
  void SetUp() override {
    directory_ = fs::temp_directory_path() / fmt::format("twinrate-csv-{}", getpid());
    fs::create_directories(directory_);
  }
  void TearDown() override { fs::remove_all(directory_); }
  std::string write(const std::string& text) const {
    std::ofstream(directory_ / "a.csv", std::ios::binary) << text;
    return (directory_ / "a.csv").string();
  }
  std::string pack(const std::string& text) const {
    const std::string path = (directory_ / "a.csv.gz").string();
    const gzFile out = gzopen(path.c_str(), "wb");
    gzwrite(out, text.data(), static_cast<unsigned>(text.size()));
    gzclose(out);
    return path;
  }
  fs::path directory_;
};

// Rows of random width, comments, blank lines, both line ends, one line longer than a block.
std::string long_text() {
  std::string text = "# made by hand\nk,x,y\n";
  for (std::uint64_t k = 0; text.size() < 1'200'000; ++k) {
    const int digits = 1 + static_cast<int>(15 * uniform(5, 0, k));
    text += fmt::format("{},{:.{}f}, {}", k, uniform(5, 1, k), digits, k % 7);
    text += k % 3 ? "\n" : "\r\n";
    if (k % 97 == 0) text += "# a comment, with, commas\n\n";
    if (k == 9000) text += "#" + std::string(600'000, '-') + "\n";
  }
  return text;
}

TEST_F(Csv, AnotherSeparatorIsReportedWithItsMapEntry) {
  for (const std::string other : {";", "\t"}) {
    const std::string path = write(fmt::format("# a\nt{0}i_q\n0{0}1\n", other));
    try {
      CsvReader reader(path, {});
      ADD_FAILURE() << other;
    } catch (const BadInput& error) {
      const std::string said = error.what(), name = other == ";" ? ";" : "\\t";
      EXPECT_TRUE(said.starts_with(path + ":2: ")) << said;
      EXPECT_NE(said.find("separator = \"" + name + "\""), std::string::npos) << said;
    }
    EXPECT_EQ(CsvReader(path, {.separator = other[0]}).header().size(), 2u);
  }
}

struct Read {
  int line;
  std::vector<std::string> fields;
};

// Oracle: the lines of the whole text.
std::vector<Read> by_lines(const std::string& text) {
  std::vector<Read> rows;
  std::istringstream in(text);
  std::string line;
  for (int number = 1; std::getline(in, line); ++number) {
    if (!line.empty() && line.back() == '\r') line.pop_back();
    if (line.empty() || line[0] == '#' || line[0] == 'k') continue;
    Read row{number, {}};
    std::istringstream fields(line);
    for (std::string field; std::getline(fields, field, ',');)
      row.fields.push_back(field.substr(field.find_first_not_of(' ')));
    rows.push_back(row);
  }
  return rows;
}

void expect_rows(CsvReader& csv, const std::vector<Read>& rows, std::size_t first) {
  std::vector<std::string_view> fields;
  for (std::size_t r = first; r < rows.size(); ++r) {
    ASSERT_TRUE(csv.next(fields)) << r;
    ASSERT_EQ(csv.line(), rows[r].line);
    ASSERT_EQ(std::vector<std::string>(fields.begin(), fields.end()), rows[r].fields);
    ASSERT_EQ(csv.at_end(), r + 1 == rows.size());
  }
  EXPECT_FALSE(csv.next(fields));
}

TEST_F(Csv, RecordsAcrossBlockBordersAreWhole) {
  const std::string text = long_text();
  const std::vector<Read> rows = by_lines(text);
  ASSERT_GT(rows.size(), 20000u);
  for (const std::string& path : {write(text), pack(text)}) {
    CsvReader csv(path, {});
    EXPECT_EQ(csv.header(), (std::vector<std::string>{"k", "x", "y"}));
    EXPECT_EQ(csv.header_line(), 2);
    expect_rows(csv, rows, 0);
    EXPECT_FALSE(csv.cut_off());
    EXPECT_EQ(csv.share_read(), 1.0);
  }
}

TEST_F(Csv, APlaceIsReadAgainFromThereOnWithItsLineNumbers) {
  const std::string text = long_text();
  const std::vector<Read> rows = by_lines(text);
  for (const std::string& path : {write(text), pack(text)}) {
    CsvReader csv(path, {});
    std::map<std::size_t, CsvReader::Place> places;
    std::vector<std::string_view> fields;
    for (std::size_t r = 0; r < rows.size(); ++r) {
      if (r % 4000 == 97 || r == 9001) places[r] = csv.place();
      csv.next(fields);
    }
    for (const std::size_t r : {std::size_t{12097}, std::size_t{97}, std::size_t{9001}}) {
      csv.go_to(places.at(r));
      expect_rows(csv, rows, r);
    }
  }
}

TEST_F(Csv, AFileWithoutALastLineEndIsReportedAsCutOff) {
  std::vector<std::string_view> fields;
  for (const std::size_t left_out : {0, 1, 2}) {
    const std::string text = "a,b\n1,2\n3,4\n";
    CsvReader csv(write(text.substr(0, text.size() - left_out)), {});
    while (csv.next(fields)) {
    }
    EXPECT_EQ(csv.cut_off(), left_out > 0);
    EXPECT_EQ(csv.line(), 3);
  }
}

TEST_F(Csv, APackedFileIsReadUpToWhereItIsCutOffAndRefusedWhereItIsCorrupt) {
  const std::string text = long_text(), path = pack(text);
  const auto size = fs::file_size(path);
  const auto read_all = [&] {
    CsvReader csv(path, {});
    std::vector<std::string_view> fields;
    std::size_t rows = 0;
    while (csv.next(fields)) ++rows;
    EXPECT_TRUE(csv.cut_off());
    return rows;
  };
  fs::resize_file(path, size / 2);
  const std::size_t all = by_lines(text).size(), half = read_all();
  EXPECT_GT(half, all / 10);
  EXPECT_LT(half, all);
  pack(text);
  std::fstream(path, std::ios::in | std::ios::out | std::ios::binary)
      .seekp(static_cast<std::streamoff>(size / 3))
      .write("\xFF\xFF\xFF\xFF\xFF\xFF\xFF\xFF", 8);
  try {
    read_all();
    ADD_FAILURE() << "not noticed";
  } catch (const BadInput& error) {
    EXPECT_NE(std::string(error.what()).find("cannot be unpacked"), std::string::npos)
        << error.what();
  }
}

}  // namespace
}  // namespace twinrate
