#include <fmt/format.h>

#include <filesystem>
#include <fstream>
#include <initializer_list>
#include <sstream>

#include "core/config.hpp"
#include "core/output_file.hpp"
#include "core/paths.hpp"
#include "report/parts.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;
using report::Json;
using report::RunView;

// An asset of every page, from share/twinrate/report if installed, else from the source tree.
std::string asset(const std::string& name) {
  const fs::path root = data_directory();
  for (const fs::path& place : {root / "report", root / "third_party" / "uplot"}) {
    std::ifstream file(place / name, std::ios::binary);
    if (!file) continue;
    std::ostringstream text;
    text << file.rdbuf();
    return text.str();
  }
  throw std::runtime_error(
      fmt::format("{}: not found under {}: install twinrate again", name, root.string()));
}

void replace_all(std::string& text, const std::string& from, const std::string& to) {
  for (std::size_t at = 0; (at = text.find(from, at)) != std::string::npos; at += to.size())
    text.replace(at, from.size(), to);
}

std::string escape_html(std::string text) {
  replace_all(text, "&", "&amp;");
  replace_all(text, "<", "&lt;");
  return text;
}

// JSON inside a script element must not end it.
std::string embedded(const Json& json) {
  std::string text = report::text_of(json);
  replace_all(text, "<", "\\u003c");
  return text;
}

// With room for all its keys: an ordered object that grows copies its content.
Json empty_page() {
  Json::object_t page;
  page.reserve(16);
  return page;
}

Json one_run(const RunView& view) {
  Json page = empty_page();
  page["verdict"] = report::verdict(view);
  page["summary"] = report::summary_table(view);
  page["sections"] = report::run_sections(view);
  page["events"] = report::event_table(view.run.log);
  page["config"] = view.run.log.config_toml;
  return page;
}

Json several_runs(const std::vector<RunView>& views) {
  Json page = empty_page();
  page["comparison"] = report::comparison_table(views);
  page["sections"] = report::comparison_sections(views);
  return page;
}

// Each placeholder occurs once in report.html, in this order: inserted text is not searched.
std::string fill(const std::string& page,
                 std::initializer_list<std::pair<std::string, const std::string&>> parts) {
  std::size_t size = page.size(), at = 0;
  for (const auto& [name, text] : parts) size += text.size();
  std::string filled;
  filled.reserve(size);
  for (const auto& [name, text] : parts) {
    const std::size_t found = page.find("{{" + name + "}}", at);
    if (found == std::string::npos)
      throw std::runtime_error("report.html: {{" + name + "}} is missing");
    filled.append(page, at, found - at).append(text);
    at = found + name.size() + 4;
  }
  filled.append(page, at);
  return filled;
}

void write_whole(const std::string& text, const std::string& out_path) {
  PartFile part(out_path);
  std::ofstream file(part.part_path(), std::ios::binary);
  file << text;
  file.close();
  if (!file) part.fail();
  part.finish();
}

}  // namespace

void write_report(const std::vector<ReportRun>& runs, const ReportOptions& options,
                  const std::string& out_path) {
  if (runs.empty()) throw BadInput("report: no run given");
  std::vector<RunView> views;
  views.reserve(runs.size());
  for (const ReportRun& run : runs) views.emplace_back(run, options.angle_reference);
  Json page = views.size() == 1 ? one_run(views.front()) : several_runs(views);
  const std::string title = options.title.empty() ? runs.front().config.name : options.title;
  page["subtitle"] =
      views.size() == 1 ? runs.front().log.path : fmt::format("{} runs", views.size());
  if (const std::string command = report::command_of(runs.front().manifest_json);
      views.size() == 1 && !command.empty())
    page["command"] = command;
  for (const std::string& note : options.notes) page["notes"].push_back(note);
  page["revision"] = runs.front().log.revision;
  report::write_page(std::move(page), title, out_path);
}

void report::write_page(Json page, const std::string& title, const std::string& out_path) {
  page["title"] = title;
  write_whole(fill(asset("report.html"), {{"TITLE", escape_html(title)},
                                          {"UPLOT_STYLE", asset("uPlot.min.css")},
                                          {"STYLE", asset("report.css")},
                                          {"UPLOT", asset("uPlot.iife.min.js")},
                                          {"PAGE", embedded(page)},
                                          {"SCRIPT", asset("report.js")}}),
              out_path);
}

}  // namespace twinrate
