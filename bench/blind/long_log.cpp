// Writes a drive log of any length with undeclared effects, as a CSV (gzipped if the name ends in
// .gz), for docs/trace-a-log.md, "Long logs".
//
//   long_log --out FILE.csv[.gz] [--seconds 600] [--kinds LIST] [--seed N] [--drive FILE.toml]
//
// The drive of bench/blind/blind_log.hpp, rich profile. Prints the true effects. --drive: writes
// the plant's drive file; `twinrate simulate` of it gives the LCM log of the same run.
#include <fmt/format.h>
#include <zlib.h>

#include <fstream>
#include <memory>

#include "bench/blind/blind_log.hpp"
#include "bench/command_line.hpp"

namespace twinrate::blind {
namespace {

void write_csv(const RawLog& raw, const std::string& path) {
  const bool packed = path.ends_with(".gz");
  const std::unique_ptr<gzFile_s, int (*)(gzFile)> file(
      gzopen(path.c_str(), packed ? "wb1" : "wbT"), gzclose);
  if (!file) throw BadInput(path + ": cannot be written");
  std::string lines = "t,i_a,i_b,i_c,u_alpha,u_beta,theta_m,v_dc,T_load\n";
  for (std::size_t k = 0; k < raw.t.size(); ++k) {
    fmt::format_to(std::back_inserter(lines),
                   "{:.7g},{:.8g},{:.8g},{:.8g},{:.8g},{:.8g},{:.12g},{:.7g},{:.6g}\n", raw.t[k],
                   raw.i_a[k], raw.i_b[k], raw.i_c[k], raw.u_alpha[k], raw.u_beta[k],
                   raw.theta_m[k], raw.v_dc[k], raw.T_load[k]);
    if (lines.size() < (1u << 20) && k + 1 < raw.t.size()) continue;
    if (gzwrite(file.get(), lines.data(), static_cast<unsigned>(lines.size())) <= 0)
      throw BadInput(path + ": the disk is full");
    lines.clear();
  }
}

struct Options {
  std::string out, drive;
  double seconds = 600;
  std::vector<std::string> kinds = {"cogging", "resistance", "load_step"};
  std::uint64_t seed = 1;
};

int run(const Options& o) {
  const Case which = make_case("rich", o.kinds, o.seed);
  fmt::print("{}\n", which.effects_toml);
  if (!o.drive.empty()) std::ofstream(o.drive) << plant_toml(which, o.seconds);
  if (!o.out.empty()) write_csv(make_log(which, o.seconds).raw, o.out);
  return 0;
}

}  // namespace
}  // namespace twinrate::blind

// An exception of CLI11 outside parsing is a mistake in the options above.
// NOLINTNEXTLINE(bugprone-exception-escape)
int main(int argc, char** argv) {
  twinrate::blind::Options o;
  twinrate::bench::CommandLine command_line{
      "Write a long drive log of the project's own plant, with undeclared effects"};
  command_line.option("--out", &o.out, "write this CSV; NAME.csv.gz is gzipped");
  command_line.option("--drive", &o.drive, "write the drive file of the plant to this file");
  command_line.option("--seconds", &o.seconds, "set the length, s");
  command_line.option("--kinds", &o.kinds, "add these effects").by_comma();
  command_line.option("--seed", &o.seed, "set the seed of effects, profile and noise");
  if (const auto status = command_line.parse(argc, argv)) return *status;
  try {
    return twinrate::blind::run(o);
  } catch (const twinrate::BadInput& error) {
    fmt::print(stderr, "long_log: {}\n", error.what());
    return 2;
  }
}
