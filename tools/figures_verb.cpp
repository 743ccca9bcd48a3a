// twinrate figures PAGE|DIR..: the figures of a report, a trace or a sweep as SVG or PDF files.
#include <fmt/format.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "core/config.hpp"
#include "core/machine_error.hpp"
#include "core/output_file.hpp"
#include "report/page_figures.hpp"
#include "sweep/figure.hpp"
#include "tools/verb.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;

struct FigureOptions {
  std::string source, out = "figures", format = "svg";
  bool force = false, json = false;
};

// rsvg-convert of librsvg2-bin makes the PDF.
void convert(const std::string& svg, const std::string& pdf) {
  const pid_t child = fork();
  if (child == 0) {
    execlp("rsvg-convert", "rsvg-convert", "-f", "pdf", "-o", pdf.c_str(), svg.c_str(), nullptr);
    _exit(127);
  }
  int status = 0;
  if (child < 0 || waitpid(child, &status, 0) < 0 || !WIFEXITED(status) ||
      WEXITSTATUS(status) != 0) {
    if (WIFEXITED(status) && WEXITSTATUS(status) == 127)
      throw MachineError(
          "--format pdf: rsvg-convert is not installed; as root: apt install librsvg2-bin");
    throw MachineError(fmt::format("{}: rsvg-convert failed", pdf));
  }
}

void put(const FigureOptions& o, const std::string& name, const std::string& svg) {
  const std::string path = fmt::format("{}/{}.{}", o.out, name, o.format);
  expect_free(path, o.force);
  PartFile part(path);
  const bool pdf = o.format == "pdf";
  const std::string drawn = pdf ? part.part_path() + ".svg" : part.part_path();
  if (!(std::ofstream(drawn) << svg << std::flush)) part.fail();
  if (pdf) {
    try {
      convert(drawn, part.part_path());
    } catch (...) {
      fs::remove(drawn);
      throw;
    }
    fs::remove(drawn);
  }
  part.finish();
  fmt::print("{}\n", o.json ? nlohmann::json{{"written", path}}.dump() : path);
}

std::string text_of(const std::string& path) {
  std::ifstream in(path);
  return {std::istreambuf_iterator<char>(in), {}};
}

void figures(const FigureOptions& o) {
  const fs::path source(o.source);
  if (fs::exists(source / "sweep.json")) {
    fs::create_directories(o.out);
    const std::string drawn = fmt::format("{}/fbmin.{}.svg", o.out, getpid());
    sweep::write_figure_of({o.source}, drawn);
    const std::string svg = text_of(drawn);
    fs::remove(drawn);
    put(o, "fbmin", svg);
    return;
  }
  const std::string page = fs::is_directory(source) ? (source / "report.html").string() : o.source;
  const auto list = report::figures_of_page(page, "twinrate figures " + o.source);
  fs::create_directories(o.out);
  for (const report::PageFigure& figure : list) put(o, figure.name, figure.svg);
}

}  // namespace

void add_figures_verb(CLI::App& app, int&) {
  auto o = std::make_shared<FigureOptions>();
  CLI::App* verb =
      app.add_subcommand("figures", "Write the figures of a report, trace or sweep as SVG or PDF");
  verb->add_option("PAGE", o->source, "read this page, or the directory of a run, trace or sweep")
      ->required();
  verb->add_option("--out", o->out, "write into this directory (default figures)");
  verb->add_option("--format", o->format, "choose the format: svg (default) or pdf")
      ->check(CLI::IsMember({"svg", "pdf"}));
  verb->add_flag("--force", o->force, "replace figures of this name");
  verb->add_flag("--json", o->json, "print JSON lines: the files as they are written");
  verb->callback([o] { figures(*o); });
}

}  // namespace twinrate
