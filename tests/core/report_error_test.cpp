// How a program ends.
#include "core/report_error.hpp"

#include <gtest/gtest.h>

#include <filesystem>

#include "core/config.hpp"
#include "core/machine_error.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;

template <class Work>
std::pair<int, std::string> ending_of(const Work& work) {
  testing::internal::CaptureStderr();
  int code = 0;
  try {
    work();
  } catch (...) {
    code = report_error("program");
  }
  return {code, testing::internal::GetCapturedStderr()};
}

TEST(ReportError, TheKindOfTheExceptionIsTheExitCode) {
  const auto is = [](int code, const std::string& line) {
    return std::pair<int, std::string>(code, line);
  };
  EXPECT_EQ(ending_of([] { throw BadInput("x"); }), is(2, "program: x\n"));
  EXPECT_EQ(ending_of([] { throw MachineError("x"); }), is(3, "program: x\n"));
  EXPECT_EQ(ending_of([] { throw std::runtime_error("x"); }), is(1, "program: x\n"));
}

TEST(ReportError, APathThatTheFileSystemRefusesIsBadInputAndAFullDiskIsNot) {
  const std::string name(300, 'a');
  const auto [code, line] = ending_of([&] { (void)fs::is_regular_file(name); });
  EXPECT_EQ(code, 2);
  EXPECT_EQ(line, "program: " + name + ": File name too long\n");
  const auto full = ending_of([] {
    throw fs::filesystem_error("", "x", std::make_error_code(std::errc::no_space_on_device));
  });
  EXPECT_EQ(full.first, 1);
}

TEST(ReportError, IsOneLineOfPrintableText) {
  EXPECT_EQ(printable("a\nb\x1b[31m\x7f"), "a\\x0ab\\x1b[31m\\x7f");
  EXPECT_EQ(printable(std::string("a\0b", 3)), "a\\x00b");
  EXPECT_EQ(printable("\xc3\xa9 \xe2\x82\xac"), "\xc3\xa9 \xe2\x82\xac");  // e acute, euro
  EXPECT_EQ(printable("\xff\xc3"), "\\xff\\xc3");
  EXPECT_EQ(printable("\xed\xa0\x80"), "\\xed\\xa0\\x80");  // half of a UTF-16 pair
  EXPECT_EQ(printable("\xe0\x80\x80"), "\\xe0\\x80\\x80");  // longer than needed
}

TEST(ReportError, AnArgumentIsUtf8) {
  const char* good[] = {"program", "\xc3\xa9.toml"};
  EXPECT_NO_THROW(expect_utf8(2, good));
  const char* bad[] = {"program", "x", "\xe9.toml"};
  EXPECT_THROW(expect_utf8(3, bad), BadInput);
}

TEST(ReportError, ALineHasABound) {
  const std::string line = printable("begin" + std::string(1'000'000, 'x') + "end");
  EXPECT_LT(line.size(), 10'000u);
  EXPECT_TRUE(line.starts_with("begin"));
  EXPECT_TRUE(line.ends_with("end"));
}

}  // namespace
}  // namespace twinrate
