// twinrate export: of an imported log, of a simulated run, interrupted.
#include <fmt/format.h>

#include <cmath>
#include <csignal>
#include <cstdlib>
#include <filesystem>

#include "tests/system/run_program.hpp"

namespace twinrate::test {
namespace {

namespace fs = std::filesystem;

class ExportProgram : public ProgramTest {};

std::string without_last_line(std::string text) {
  return text.erase(text.rfind('\n', text.size() - 2) + 1);
}

TEST_F(ExportProgram, ImportedRowsAreExportedUnchanged) {
  std::string log = "t,i_a,i_b,i_c,u_alpha,u_beta,duty_a,duty_b,duty_c,v_dc,theta_m,omega_m\n";
  std::string q_log = "t,i_q,theta_m\n";
  for (int k = 0; k < 300; ++k) {
    if (k == 120) continue;  // a lost row
    const double x = std::sin(0.1 * k), y = std::cos(0.07 * k);
    log += fmt::format("{},{},{},{},{},{},{},{},{},{},{},{}\n", k / 1e4, x, y, -x - y, 30 * y,
                       20 * x, 0.5 + 0.1 * x, 0.5, 0.4 * y * y, 235 + x, 0.02 * k, 200 + y);
    q_log += fmt::format("{},{:.9f},{}\n", k / 1e4, x, 0.02 * k);
  }
  write_text(path("log.csv"), log);
  ASSERT_EQ(
      twinrate({"import", path("log.csv"), "--drive", "niewiara2020", "--out", path("log.lcm")})
          .exit_code,
      0);
  const ProgramResult result =
      twinrate({"export", path("log.lcm"), "--format", "csv", "--out", path("back.csv")});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(read_text(path("back.csv")), without_last_line(log));
  write_text(path("q.csv"), q_log);
  ASSERT_EQ(twinrate({"import", path("q.csv"), "--drive", "niewiara2020", "--out", path("q.lcm")})
                .exit_code,
            0);
  ASSERT_EQ(
      twinrate({"export", path("q.lcm"), "--format", "csv", "--out", path("q_back.csv")}).exit_code,
      0);
  const std::string back = read_text(path("q_back.csv"));
  EXPECT_TRUE(back.starts_with("t,i_q,theta_m\n")) << back.substr(0, 80);
  EXPECT_EQ(count_lines(back), count_lines(q_log)) << "no voltage, so no row is without one";
}

TEST_F(ExportProgram, AnImportWarnsOfATimeInMilliseconds) {
  std::string log = "t,i_a,i_b,i_c,u_alpha,u_beta,theta_m\n";
  for (int k = 0; k < 400; ++k) {
    const double a = 0.05 * k, i = std::cos(a), j = std::cos(a - 2.0944);
    log += fmt::format("{:.1f},{},{},{},{},{},{}\n", 0.2 * k, i, j, -i - j, 40 * std::sin(a),
                       40 * std::cos(a), a / 3);
  }
  write_text(path("ms.csv"), log);
  const ProgramResult result =
      twinrate({"import", path("ms.csv"), "--drive", "niewiara2020", "--out", path("ms.lcm")});
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(result.out.find("warning: t is expected to be "), std::string::npos) << result.out;
  EXPECT_NE(result.out.find("(milliseconds?)"), std::string::npos) << result.out;
  EXPECT_EQ(result.out.find("--set rates.f_s_Hz"), std::string::npos) << result.out;
}

TEST_F(ExportProgram, FiguresArePdfWhereThereIsAConverterAndElseItSaysSo) {
  ASSERT_EQ(twinrate({"simulate", "dilys2021", "--duration", "200ms", "--run-dir", path("run"),
                      "--set", "run.settle_s=0.1"})
                .exit_code,
            0);
  const bool converter = std::system("command -v rsvg-convert >/dev/null") == 0;
  const ProgramResult result =
      twinrate({"figures", path("run"), "--format", "pdf", "--out", path("figures")});
  EXPECT_EQ(result.exit_code, converter ? 0 : 3) << result.err;
  if (converter) {
    EXPECT_TRUE(read_text(path("figures/01-speed.pdf")).starts_with("%PDF"));
    EXPECT_EQ(
        twinrate({"figures", path("run"), "--format", "pdf", "--out", path("figures")}).exit_code,
        2)
        << "nothing is overwritten";
  } else {
    EXPECT_NE(result.err.find("librsvg2-bin"), std::string::npos) << result.err;
    EXPECT_TRUE(fs::is_empty(path("figures")));
  }
}

TEST_F(ExportProgram, ARunGoesIntoEveryFormatAndBackIntoTheTracersInput) {
  ASSERT_EQ(twinrate({"simulate", "niewiara2020", "--duration", "300ms", "--run-dir", path("run")})
                .exit_code,
            0);
  for (const char* format : {"csv", "mat", "mcap"}) {
    const ProgramResult result = twinrate({"export", path("run"), "--format", format});
    ASSERT_EQ(result.exit_code, 0) << result.err;
    EXPECT_GT(fs::file_size(path(std::string("run/log.") + format)), 100'000u) << format;
    if (std::string(format) == "csv") continue;
    const std::string back = path(std::string(format) + ".lcm");
    ASSERT_EQ(twinrate({"import", path(std::string("run/log.") + format), "--out", back}).exit_code,
              0);
    EXPECT_TRUE(read_text(back) == read_text(path("run/log.lcm"))) << format << ": bit for bit";
  }
  // A full disk: one line, and no file that looks whole. matio itself reports nothing.
  if (mount_small_disk("disk", "64k"))
    for (const char* format : {"csv", "mat", "mcap"}) {
      const std::string out = path(std::string("disk/log.") + format);
      const ProgramResult full =
          twinrate({"export", path("run"), "--format", format, "--out", out});
      EXPECT_EQ(full.exit_code, 1) << format;
      EXPECT_EQ(count_lines(full.err), 1) << full.err;
      EXPECT_FALSE(fs::exists(out)) << format;
    }
  const std::string table = read_text(path("run/log.csv"));
  EXPECT_TRUE(table.starts_with(
      "t,i_a,i_b,i_c,u_alpha,u_beta,duty_a,duty_b,duty_c,v_dc,theta_m,omega_m,T_load,omega_m_ref,"
      "i_d_ref,i_q_ref\n"))
      << table.substr(0, 200);
  EXPECT_EQ(count_lines(table), 3000);
  const ProgramResult again = twinrate(
      {"import", path("run/log.csv"), "--drive", "niewiara2020", "--out", path("again.lcm")});
  EXPECT_EQ(again.exit_code, 0) << again.err;
}

TEST_F(ExportProgram, AnInterruptedExportKeepsWholeRowsAndReportsIt) {
  std::string text = "t,i_a,i_b,u_alpha,u_beta,theta_m\n";
  for (int k = 0; k < 1'500'000; ++k) {  // seconds of work
    text += std::to_string(k);
    text += "e-4,0.5,-0.25,10,5,1\n";
  }
  write_text(path("long.csv"), text);
  Program run({"twinrate", "export", path("long.csv"), "--format", "csv", "--out", path("part.csv"),
               "--json"});
  ASSERT_TRUE(wait_until([&] { return run.out().find("exporting 10") != std::string::npos; }));
  run.signal(SIGINT);
  const ProgramResult result = run.wait(10);
  EXPECT_EQ(result.exit_code, 1) << result.err;
  EXPECT_EQ(count_lines(result.err), 1);
  EXPECT_NE(result.err.find("interrupted"), std::string::npos);
  EXPECT_NE(result.out.find("\"interrupted\":true"), std::string::npos);
  const std::string kept = read_text(path("part.csv"));
  EXPECT_GT(count_lines(kept), 1000);
  EXPECT_LT(count_lines(kept), 1'500'000);
  EXPECT_TRUE(kept.ends_with(",0.5,-0.25,10,5,1\n")) << kept.substr(kept.size() - 60);
  EXPECT_FALSE(fs::exists(path("part.csv.part")));
}

// What a program prints is its result, too.
TEST_F(ExportProgram, AnOutputThatCannotBeWrittenIsNotDone) {
  const auto check = [](const std::string& to) {
    return run_program(
        {"sh", "-c", std::string(TWINRATE_PROGRAM) + " check dilys2021 --resolved " + to});
  };
  const ProgramResult full = check("> /dev/full");
  EXPECT_EQ(full.exit_code, 1);
  EXPECT_EQ(full.err, "twinrate: the output cannot be written: No space left on device\n");
  EXPECT_EQ(check(">&-").exit_code, 0) << "closed by intent";
  EXPECT_EQ(check("| head -1").exit_code, 0);
}

TEST_F(ExportProgram, MistakesAreOneLine) {
  write_text(path("log.csv"), "t,i_q,theta_m\n0,1,2\n");
  for (const std::vector<std::string>& more :
       {std::vector<std::string>{"--format", "xlsx"},
        {"--format", "csv"},  // would be written over the log itself
        {"--format", "csv", "--out", path("no/such/out.csv")},
        {"--format", "mat", "--from", "3", "--to", "2"},
        {"--format", "mcap", "--channels", "SPEED"}}) {
    std::vector<std::string> list = {"export", path("log.csv")};
    list.insert(list.end(), more.begin(), more.end());
    const ProgramResult result = twinrate(list);
    EXPECT_EQ(result.exit_code, 2) << result.out;
    EXPECT_EQ(count_lines(result.err), 1) << result.err;
  }
  EXPECT_EQ(twinrate({"export", path("none.lcm"), "--format", "csv"}).exit_code, 2);
}

}  // namespace
}  // namespace twinrate::test
