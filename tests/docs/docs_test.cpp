// The pages agree with the program: tables equal those of the code; links, paths, verbs and keys
// exist.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <regex>
#include <set>
#include <sstream>

#include "core/channels.hpp"
#include "core/reason.hpp"
#include "model/effects/effect.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;
const fs::path kRoot = TWINRATE_SOURCE_DIR;

std::string text_of(const fs::path& path) {
  std::ifstream file(path);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

std::string output_of(const std::string& arguments) {
  std::string output;
  FILE* pipe = popen((std::string(TWINRATE_PROGRAM) + " " + arguments).c_str(), "r");
  if (!pipe) return output;
  char block[4096];
  for (std::size_t got = 0; (got = fread(block, 1, sizeof block, pipe)) > 0;)
    output.append(block, got);
  pclose(pipe);
  return output;
}

std::vector<fs::path> pages() {
  std::vector<fs::path> list = {kRoot / "README.md", kRoot / "ARCHITECTURE.md"};
  for (const auto& entry : fs::recursive_directory_iterator(kRoot / "docs"))
    if (entry.path().extension() == ".md") list.push_back(entry.path());
  return list;
}

// Group 1 of every match of `pattern`.
std::vector<std::string> found(const std::string& text, const std::string& pattern) {
  const std::regex regex(pattern);
  std::vector<std::string> list;
  for (std::sregex_iterator it(text.begin(), text.end(), regex), end; it != end; ++it)
    list.push_back((*it)[1]);
  return list;
}

// The rows of the Markdown table whose header line is `header`.
std::vector<std::string> table_rows(const std::string& text, const std::string& header) {
  std::istringstream in(text.substr(std::min(text.find(header + "\n"), text.size())));
  std::vector<std::string> rows;
  std::string line;
  std::getline(in, line), std::getline(in, line);
  while (std::getline(in, line) && line.starts_with("|")) rows.push_back(line);
  return rows;
}

// The name GitHub gives a heading in a link.
std::string anchor_of(const std::string& heading) {
  std::string anchor;
  for (const char c : heading) {
    if (std::isalnum(static_cast<unsigned char>(c)) || c == '-' || c == '_')
      anchor += static_cast<char>(std::tolower(c));
    else if (c == ' ')
      anchor += '-';
  }
  return anchor;
}

bool has_anchor(const fs::path& page, const std::string& anchor) {
  for (const std::string& heading : found(text_of(page), R"((?:^|\n)#+ ([^\n]*))"))
    if (anchor_of(heading) == anchor) return true;
  return text_of(page).find("<a id=\"" + anchor + "\">") != std::string::npos;
}

TEST(Architecture, ListsEveryChannelAsTheCodeDoes) {
  std::vector<std::string> rows;
  rows.reserve(std::size(kChannels));
  for (const ChannelInfo& channel : kChannels)
    rows.push_back(fmt::format("| `{}` | `{}` | {} | {} |", channel.name, channel.type,
                               channel.from, channel.to));
  EXPECT_EQ(table_rows(text_of(kRoot / "ARCHITECTURE.md"), "| channel | type | from | to |"), rows);
}

TEST(ReasonCodes, ArePrintedAsTheCodeHasThem) {
  std::vector<std::string> rows;
  rows.reserve(std::size(kReasons));
  for (const ReasonText& reason : kReasons)
    rows.push_back(fmt::format("| {} | `{}` | {} |", static_cast<int>(reason.reason), reason.name,
                               reason.meaning));
  EXPECT_EQ(table_rows(text_of(kRoot / "docs/reason-codes.md"), "| code | name | meaning |"), rows);
}

TEST(ConfigReference, IsWhatTheProgramPrints) {
  const std::string program = output_of("check --reference");
  ASSERT_FALSE(program.empty());
  EXPECT_TRUE(text_of(kRoot / "docs/config-reference.md") == program)
      << "run: twinrate check --reference > docs/config-reference.md";
}

TEST(DriveSchema, IsWhatTheProgramPrints) {
  const std::string program = output_of("check --schema");
  ASSERT_FALSE(program.empty());
  EXPECT_TRUE(text_of(kRoot / "config/drive.schema.json") == program)
      << "run: twinrate check --schema > config/drive.schema.json";
}

// Of the presets, each with one line changed by `change`: what check refuses for key, type or range
// fails in an editor with the schema, too.
TEST(DriveSchema, AnEditorRefusesWhatCheckRefuses) {
  if (std::system("command -v taplo >/dev/null") != 0)
    GTEST_SKIP() << "taplo is not installed: npm install --global @taplo/cli";
  const auto lint = [](const std::string& change) {
    const std::string text = "sed '" + change + "' '" + (kRoot / "config/dilys2021.toml").string();
    return std::system((text + "' | taplo lint --schema file://" +
                        (kRoot / "config/drive.schema.json").string() + " - >/dev/null 2>&1")
                           .c_str());
  };
  const std::string presets = "taplo lint --schema file://" +
                              (kRoot / "config/drive.schema.json").string() + " " +
                              (kRoot / "config").string() + "/*.toml >/dev/null 2>&1";
  EXPECT_EQ(std::system(presets.c_str()), 0);
  for (const char* change :
       {"s/^n_p = .*/n_p = 0/", "s/^n_p = .*/n_p = 4.5/", "s/^f_s_Hz/f_s_Hzz/",
        "s/^psi_f_Wb = .*/psi_f_Wb = \"x\"/", "s/^kind = .*/kind = \"none\"/",
        "s/^v_dc_V.*/v_dc_V = -3/", "s/^seed.*/seed = 1.5/", "s/^.rates./[ratez]/"})
    EXPECT_NE(lint(change), 0) << change;
}

// tools/effect-gallery makes them.
TEST(EffectsGallery, HasAPageWithASmallFigureOfEveryEffect) {
  const std::string index = text_of(kRoot / "docs/effects-gallery.md");
  for (const std::string& kind : effect_kinds()) {
    EXPECT_NE(index.find("(effects/" + kind + ".md)"), std::string::npos) << kind;
    const fs::path page = kRoot / "docs/effects" / (kind + ".md");
    EXPECT_NE(text_of(page).find("](" + kind + ".svg)"), std::string::npos) << kind;
    const std::string figure = text_of(kRoot / "docs/effects" / (kind + ".svg"));
    EXPECT_GT(figure.size(), 5000u) << kind;
    EXPECT_LT(figure.size(), 60000u) << kind;
  }
}

TEST(AddingAnEffect, ShowsTheFileAsItStandsInTheTree) {
  const std::string file = text_of(kRoot / "model/effects/fan_load.cpp");
  ASSERT_FALSE(file.empty());
  EXPECT_NE(text_of(kRoot / "docs/adding-an-effect.md").find("```cpp\n" + file + "```\n"),
            std::string::npos);
}

// Everybody else asks for traits. The exceptions are the traces of static sets and of logs of angle
// and current, which fit a fixed list of effects, and the identification, which writes one.
TEST(KindsOfEffects, StandInQuotesInTheirOwnFilesAlone) {
  const std::set<std::string> other = {"tests", "bench", "docs", "config", "third_party", "cmake"};
  const std::set<std::string> exceptions = {"flux_map.cpp", "inverter_curve.cpp",
                                            "position_effects.cpp", "position_trace.cpp"};
  int files = 0;
  for (const fs::directory_entry& folder : fs::directory_iterator(kRoot)) {
    const std::string name = folder.path().filename().string();
    if (!folder.is_directory() || other.contains(name) || name.starts_with("build") ||
        name.starts_with("."))
      continue;
    for (const fs::directory_entry& entry : fs::recursive_directory_iterator(folder)) {
      const fs::path& path = entry.path();
      if ((path.extension() != ".cpp" && path.extension() != ".hpp") ||
          path.parent_path() == kRoot / "model/effects" ||
          (name == "trace" && exceptions.contains(path.filename().string())))
        continue;
      if (path == kRoot / "identify/write.cpp") continue;
      ++files;
      const std::string text = text_of(path);
      for (const std::string& kind : effect_kinds()) {
        EXPECT_EQ(text.find("\"" + kind + "\""), std::string::npos) << path << ": " << kind;
        EXPECT_EQ(text.find("\\\"" + kind + "\\\""), std::string::npos) << path << ": " << kind;
      }
    }
  }
  EXPECT_GT(files, 300);
}

TEST(PhysicsOfEffects, IsAllThatPlantEstimatorAndControllerInclude) {
  const std::regex other(
      R"(#include "model/effects/(tracing|traits|portrait|catalogue|registry)\.hpp")");
  std::vector<fs::path> files = {
      kRoot / "model/effects/effect.hpp", kRoot / "model/effects/physics.hpp",
      kRoot / "model/effects/undo.hpp", kRoot / "model/effects/flux_map.hpp",
      kRoot / "model/effects/shaft.hpp"};
  for (const char* folder : {"plant_sim", "estimator", "controller"})
    for (const fs::directory_entry& entry : fs::recursive_directory_iterator(kRoot / folder))
      if (entry.is_regular_file()) files.push_back(entry.path());
  for (const fs::path& path : files) EXPECT_FALSE(std::regex_search(text_of(path), other)) << path;
  EXPECT_GT(files.size(), 60u);
}

TEST(Links, LeadToAFileAndToAHeadingInIt) {
  for (const fs::path& page : pages()) {
    for (const std::string& link : found(text_of(page), R"(\]\(([^)\s]+)\))")) {
      if (link.starts_with("http")) continue;
      const auto hash = link.find('#');
      const std::string file = link.substr(0, hash);
      const fs::path target = file.empty() ? page : page.parent_path() / file;
      EXPECT_TRUE(fs::exists(target)) << page << " links to " << link;
      if (hash == std::string::npos) continue;
      EXPECT_TRUE(has_anchor(target, link.substr(hash + 1))) << page << " links to " << link;
    }
  }
}

TEST(Presets, AreTheOnesOfThePage) {
  std::set<std::string> on_the_page, in_config;
  const std::string list =
      found(text_of(kRoot / "docs/run-a-drive.md"), "\\$ twinrate machine list\npreset ([^`]*)```")
          .at(0);
  std::istringstream rows(list.substr(list.find('\n') + 1));
  for (std::string row; std::getline(rows, row);) on_the_page.insert(row.substr(0, row.find(' ')));
  for (const auto& entry : fs::directory_iterator(kRoot / "config"))
    if (entry.path().extension() == ".toml") in_config.insert(entry.path().stem().string());
  EXPECT_EQ(on_the_page, in_config);
}

// `core/rates.hpp`, `estimator/ekf_sensorless.*`, `tests/plant_sim/`; not NAME.cpp, nor the example
// that does not exist.
TEST(Paths, NamedInThePagesExist) {
  const std::string folders =
      "lcmtypes|model|core|plant_sim|estimator|controller|logger|loop|lanes|analysis|trace|import|"
      "drive_log|export|verify|plan|sweep|report|run|monitor|tools|config|tests|bench|docs";
  for (const fs::path& page : pages()) {
    for (std::string path : found(text_of(page), "`((?:" + folders + ")/[a-z0-9_./*-]*)`")) {
      if (path.find("fan_load") != std::string::npos) continue;
      const bool any_of_a_kind = path.ends_with(".*");
      if (any_of_a_kind) path.replace(path.size() - 2, 2, ".cpp");
      EXPECT_TRUE(fs::exists(kRoot / path) ||
                  fs::exists(kRoot / fs::path(path).replace_extension(".hpp")))
          << page << " names " << path;
    }
  }
}

TEST(Verbs, NamedInThePagesExist) {
  const std::string help = output_of("--help");
  const auto list =
      found(help.substr(std::min(help.find("Subcommands:"), help.size())), R"(\n  ([a-z]+)\s)");
  const std::set<std::string> verbs(list.begin(), list.end());
  ASSERT_TRUE(verbs.count("launch"));
  for (const fs::path& page : pages())
    for (const std::string& verb : found(text_of(page), R"((?:^|[^-_A-Za-z])twinrate ([a-z]+))"))
      EXPECT_TRUE(verbs.count(verb)) << page << " names twinrate " << verb;
}

// The unknown key in the example of docs/run-a-drive.md.
const std::string kMistake = "rates.m";

TEST(Keys, NamedInThePagesExist) {
  const std::string reference = text_of(kRoot / "docs/config-reference.md");
  const auto list = found(reference, "\\| `([^`]*)`");
  const std::set<std::string> keys(list.begin(), list.end());
  const std::string tables =
      "machine|inverter|sensors|rates|gain|plant|reference|load|run|bus|monitor|bridge|estimator|"
      "controller|steering";
  for (const fs::path& page : pages()) {
    const std::string text = text_of(page);
    for (const std::string& key : found(text, "`((?:" + tables + ")\\.[a-z][A-Za-z0-9_.]*)[`= ]")) {
      EXPECT_TRUE(keys.count(key)) << page << " names the key " << key;
    }
    for (const std::string& key : found(text, "--set ((?:" + tables + ")\\.[A-Za-z0-9_.]*)="))
      EXPECT_TRUE(keys.count(key) || key == kMistake) << page << " sets the key " << key;
  }
}

}  // namespace
}  // namespace twinrate
