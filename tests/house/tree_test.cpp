// The tree: which folder may include which, and ARCHITECTURE.md's picture of it.
//
// kRooms lists the folders from the bottom up. A folder includes itself and what its line names;
// a line names only folders above it in the list, so the includes have no circle.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <regex>
#include <set>
#include <sstream>
#include <string>
#include <vector>

namespace twinrate {
namespace {

namespace fs = std::filesystem;
const fs::path kRoot = TWINRATE_SOURCE_DIR;

struct Room {
  std::string folder;
  std::vector<std::string> may_include;
};

constexpr const char* kEveryRoom = "*";  // that stands above it in the list

const std::vector<Room> kRooms = {
    {"firmware", {}},
    {"model", {}},
    {"core", {"model"}},
    {"safety", {"model", "core"}},
    {"plant_sim", {"model", "core", "safety"}},
    {"estimator", {"model", "core"}},
    {"controller", {"model", "core"}},
    {"logger", {"core"}},
    {"analysis", {"model", "core"}},
    {"trace", {"model", "core"}},
    {"monitor", {"model", "core", "trace"}},
    {"loop", {"model", "core", "plant_sim", "estimator", "controller", "monitor"}},
    {"datasheet", {"model", "core", "loop"}},
    {"lanes", {"model", "core", "estimator", "controller"}},
    {"import", {"model", "core"}},
    {"bridge", {"firmware", "model", "core", "safety", "plant_sim"}},
    {"identify", {"model", "core", "plant_sim", "loop", "bridge"}},
    {"emulator",
     {"firmware", "model", "core", "safety", "plant_sim", "controller", "loop", "import",
      "bridge"}},
    {"drive_log", {"model", "core", "trace", "loop", "import"}},
    {"export", {"model", "core", "trace", "import", "drive_log"}},
    {"stream", {"core", "export"}},
    {"verify", {"model", "core", "plant_sim", "trace", "loop", "import", "drive_log"}},
    {"report", {"model", "core", "analysis", "trace"}},
    {"response", {"model", "core", "plant_sim", "controller", "loop", "report"}},
    {"plan", {"model", "core", "trace", "loop", "report"}},
    {"sweep", {"model", "core", "estimator", "analysis", "loop", "lanes"}},
    {"embedded",
     {"firmware", "model", "core", "plant_sim", "estimator", "controller", "analysis", "loop"}},
    {"tune", {"model", "core", "estimator", "analysis", "loop", "sweep"}},
    {"run", {"core", "logger", "analysis", "monitor", "loop", "report"}},
    {"scope", {"model", "core"}},
    {"tools", {kEveryRoom}},
    {"python",
     {"model", "core", "estimator", "controller", "loop", "export", "tools", "report", "run"}},
    {"tests", {kEveryRoom}},
    {"bench",
     {"model", "core", "plant_sim", "estimator", "controller", "analysis", "trace", "loop", "lanes",
      "tests", "bridge", "emulator", "identify", "run"}},
};

// Messages, data and scripts: nothing in them is compiled here.
const std::set<std::string> kWithoutSources = {"lcmtypes", "config",      "docs",
                                               "cmake",    "third_party", "examples"};

const Room* room_of(const std::vector<Room>& rooms, const std::string& folder) {
  for (const Room& room : rooms)
    if (room.folder == folder) return &room;
  return nullptr;
}

std::string text_of(const fs::path& path) {
  std::ifstream file(path);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

// The quoted includes of a source, in order.
std::vector<std::string> includes(const std::string& text) {
  std::vector<std::string> list;
  std::istringstream in(text);
  for (std::string line; std::getline(in, line);) {
    line.erase(std::remove(line.begin(), line.end(), ' '), line.end());
    if (!line.starts_with("#include\"")) continue;
    const auto begin = line.find('"') + 1;
    list.push_back(line.substr(begin, line.find('"', begin) - begin));
  }
  return list;
}

bool may_include(const std::vector<Room>& rooms, const Room& room, const std::string& target) {
  const auto& names = room.may_include;
  if (names == std::vector<std::string>{kEveryRoom}) {
    const Room* other = room_of(rooms, target);
    return other && other < &room;
  }
  return std::count(names.begin(), names.end(), target) > 0;
}

// The includes of `text`, a source in `folder`, that the rooms do not allow.
std::vector<std::string> wrong_includes(const std::vector<Room>& rooms, const std::string& folder,
                                        const std::string& text) {
  const Room* room = room_of(rooms, folder);
  std::vector<std::string> wrong;
  for (const std::string& include : includes(text)) {
    const std::string target = include.substr(0, include.find('/'));
    const bool allowed = room && (target == folder || may_include(rooms, *room, target));
    if (!allowed) wrong.push_back(include);
  }
  return wrong;
}

std::set<std::string> top_folders() {
  std::set<std::string> folders;
  for (const auto& entry : fs::directory_iterator(kRoot)) {
    const std::string name = entry.path().filename().string();
    const bool of_the_tree = entry.is_directory() && !name.starts_with(".") &&
                             !name.starts_with("build") && name != "runs";
    if (of_the_tree) folders.insert(name);
  }
  return folders;
}

std::vector<fs::path> sources_in(const std::string& folder) {
  std::vector<fs::path> list;
  for (const auto& entry : fs::recursive_directory_iterator(kRoot / folder)) {
    const std::string kind = entry.path().extension().string();
    if (kind == ".cpp" || kind == ".hpp" || kind == ".h") list.push_back(entry.path());
  }
  return list;
}

TEST(Rooms, AreTheFoldersWithSources) {
  std::set<std::string> rooms;
  for (const Room& room : kRooms) rooms.insert(room.folder);
  std::set<std::string> folders = top_folders();
  for (const std::string& folder : kWithoutSources) {
    EXPECT_EQ(folders.erase(folder), 1u) << folder << " is not there";
    EXPECT_TRUE(sources_in(folder).empty() || folder == "third_party") << folder;
  }
  EXPECT_EQ(rooms, folders);
}

TEST(Rooms, NameOnlyRoomsBelowThem) {
  std::set<std::string> below;
  for (const Room& room : kRooms) {
    for (const std::string& name : room.may_include)
      EXPECT_TRUE(name == kEveryRoom || below.count(name))
          << room.folder << " may include " << name << ", which is not below it";
    below.insert(room.folder);
  }
}

TEST(Rooms, OfTheProcessesDoNotNameEachOther) {
  const std::set<std::string> processes = {"plant_sim", "estimator", "controller", "logger",
                                           "monitor"};
  for (const Room& room : kRooms)
    for (const std::string& name : room.may_include)
      EXPECT_FALSE(processes.count(room.folder) && processes.count(name))
          << room.folder << " may include " << name;
}

TEST(Includes, GoWhereTheRoomsAllow) {
  std::size_t seen = 0;
  for (const Room& room : kRooms)
    for (const fs::path& source : sources_in(room.folder)) {
      const std::string text = text_of(source);
      seen += includes(text).size();
      for (const std::string& include : wrong_includes(kRooms, room.folder, text))
        ADD_FAILURE() << fs::relative(source, kRoot).string() << " includes " << include << ", "
                      << room.folder << "/ may not";
    }
  EXPECT_GT(seen, 800u);
}

TEST(Includes, AWrongOneIsFound) {
  const std::string text =
      "#include \"model/frames.hpp\"\n#include <vector>\n  #  include \"core/bus.hpp\"\n";
  EXPECT_EQ(wrong_includes(kRooms, "model", text), std::vector<std::string>{"core/bus.hpp"});
  EXPECT_TRUE(wrong_includes(kRooms, "core", text).empty());
  EXPECT_EQ(wrong_includes(kRooms, "plant_sim", "#include \"estimator/filter.hpp\"\n").size(), 1u);
  EXPECT_EQ(wrong_includes(kRooms, "core", "#include \"frames.hpp\"\n").size(), 1u);
  EXPECT_EQ(wrong_includes(kRooms, "attic", "#include \"model/frames.hpp\"\n").size(), 1u);
  EXPECT_TRUE(wrong_includes(kRooms, "tools", "#include \"sweep/plan.hpp\"\n").empty());
  EXPECT_EQ(wrong_includes(kRooms, "tools", "#include \"tests/support/drives.hpp\"\n").size(), 1u);
}

// Calls of the elementary functions that glibc selects by the processor.
std::vector<std::string> system_functions(const std::string& text) {
  static const std::regex call(
      R"(std::(sin|cos|tan|asin|acos|atan|atan2|exp|exp2|expm1|log|log2|log10|log1p|pow|sinh|cosh|tanh|polar|arg)\()");
  return {std::sregex_token_iterator(text.begin(), text.end(), call, 0), {}};
}

TEST(Loop, CallsNoElementaryFunctionOfTheSystem) {
  std::size_t own = 0;
  for (const char* folder :
       {"model", "safety", "plant_sim", "estimator", "controller", "loop", "lanes"})
    for (const fs::path& source : sources_in(folder)) {
      const std::string text = text_of(source);
      own += text.find("math::") != std::string::npos;
      for (const std::string& call : system_functions(text))
        ADD_FAILURE() << fs::relative(source, kRoot).string() << " calls " << call
                      << ": model/math.hpp has one with the same bits on every machine";
    }
  EXPECT_GT(own, 30u);
}

TEST(Loop, ACallOfTheSystemsFunctionIsFound) {
  EXPECT_EQ(system_functions("x = std::sin(y) + math::cos(y) + std::sqrt(y);").size(), 1u);
  EXPECT_EQ(system_functions("z = std::polar(1.0, w) * std::pow(z, 2);").size(), 2u);
}

// Kinds of effects by the table of the registry.
std::vector<std::string> kinds_in(const std::string& registry) {
  static const std::regex row(R"re(\{"([a-z_0-9]+)", make_)re");
  return {std::sregex_token_iterator(registry.begin(), registry.end(), row, 1), {}};
}

// `allowed`: folders that make effects by their name: the effects themselves, the tracer's static sets and
// positions, the report of an identification, and drawn drives.
TEST(Kinds, AreInQuotesOnlyWhereEffectsAreMade) {
  const std::set<std::string> allowed = {"model", "trace", "identify", "bench", "tests"};
  const auto kinds = kinds_in(text_of(kRoot / "model/effects/registry.cpp"));
  EXPECT_GT(kinds.size(), 30u);
  for (const Room& room : kRooms) {
    if (allowed.count(room.folder)) continue;
    for (const fs::path& source : sources_in(room.folder)) {
      const std::string text = text_of(source);
      for (const std::string& kind : kinds)
        EXPECT_EQ(text.find('"' + kind + '"'), std::string::npos)
            << fs::relative(source, kRoot).string() << " has the kind \"" << kind
            << "\": ask the effect for its trait (model/effects/traits.hpp)";
    }
  }
}

// | `core/` | what it holds |
TEST(Architecture, ListsTheFoldersThereAre) {
  const std::string text = text_of(kRoot / "ARCHITECTURE.md");
  const auto begin = text.find("| folder | what it holds |");
  ASSERT_NE(begin, std::string::npos);
  std::istringstream table(text.substr(begin));
  std::string line;
  std::getline(table, line);
  std::getline(table, line);
  std::set<std::string> listed;
  while (std::getline(table, line) && line.starts_with("|")) {
    const auto open = line.find('`'), close = line.find('`', open + 1);
    ASSERT_NE(close, std::string::npos) << line;
    const std::string folder = line.substr(open + 1, close - open - 1);
    EXPECT_TRUE(folder.ends_with("/") && fs::is_directory(kRoot / folder)) << line;
    const std::string name = folder.substr(0, folder.size() - 1);
    if (name.find('/') != std::string::npos) continue;  // model/effects/
    EXPECT_TRUE(listed.insert(name).second) << name << " is listed twice";
  }
  EXPECT_EQ(listed, top_folders());
}

// A file of tests that no list names is never built, and its tests never fail.
TEST(Tests, EachFileOfThemIsBuilt) {
  const std::string list = text_of(kRoot / "tests/CMakeLists.txt");
  std::size_t files = 0;
  for (const auto& file : fs::recursive_directory_iterator(kRoot / "tests")) {
    const std::string name = file.path().filename().string();
    if (!name.ends_with("_test.cpp")) continue;
    ++files;
    const fs::path own = file.path().parent_path() / "CMakeLists.txt";
    const std::string beside = fs::exists(own) ? text_of(own) : "";
    EXPECT_TRUE(list.find(name) != std::string::npos || beside.find(name) != std::string::npos)
        << file.path();
  }
  EXPECT_GT(files, 100u);
}

}  // namespace
}  // namespace twinrate
