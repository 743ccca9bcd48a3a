// A reader of MCAP files, independent of the writer; checks the offsets of data and index as it reads.
#pragma once
#include <gtest/gtest.h>

#include <cstdint>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace twinrate {

class McapFile {
 public:
  explicit McapFile(const std::string& path) {
    std::ifstream in(path, std::ios::binary);
    bytes_.assign(std::istreambuf_iterator<char>(in), {});
    const std::string magic("\x89MCAP0\r\n", 8);
    EXPECT_EQ(bytes_.substr(0, 8), magic);
    EXPECT_EQ(bytes_.substr(bytes_.size() - 8), magic);
    read(8, bytes_.size() - 8, false);
  }
  struct Message {
    std::uint64_t log_time;
    nlohmann::json body;
  };
  std::map<std::string, std::vector<Message>> messages;  // by topic
  std::map<std::string, nlohmann::json> schemas;
  int chunks = 0, chunk_indexes = 0, indexed = 0;
  std::uint64_t counted = 0, summary_begin = 0, data_end = 0;
  std::vector<int> opcodes;  // outside chunks

 private:
  std::uint64_t whole(std::size_t at, int size) const {
    std::uint64_t value = 0;
    for (int i = size; i-- > 0;)
      value = value << 8 | static_cast<unsigned char>(bytes_.at(at + static_cast<std::size_t>(i)));
    return value;
  }
  std::string text(std::size_t& at) const {
    const auto length = static_cast<std::size_t>(whole(at, 4));
    const std::string s = bytes_.substr(at + 4, length);
    at += 4 + length;
    return s;
  }
  void read(std::size_t at, std::size_t end, bool in_chunk) {
    while (at < end) {
      const int opcode = static_cast<int>(whole(at, 1));
      const auto length = static_cast<std::size_t>(whole(at + 1, 8));
      if (!in_chunk) opcodes.push_back(opcode);
      take(opcode, at + 9, length, at);
      at += 9 + length;
    }
    EXPECT_EQ(at, end) << "records fill what holds them";
  }
  void take(int opcode, std::size_t at, std::size_t length, std::size_t record_at) {
    const std::size_t end = at + length;
    if (opcode == 3) {
      const auto id = whole(at, 2);
      at += 2;
      schema_names_[id] = text(at);
      EXPECT_EQ(text(at), "jsonschema");
      schemas[schema_names_[id]] = nlohmann::json::parse(text(at));
    } else if (opcode == 4) {
      const auto id = whole(at, 2);
      EXPECT_TRUE(schema_names_.count(whole(at + 2, 2)));
      at += 4;
      topics_[id] = text(at);
      EXPECT_EQ(text(at), "json");
    } else if (opcode == 5) {
      const std::string& topic = topics_.at(whole(at, 2));
      EXPECT_EQ(whole(at + 2, 4), messages[topic].size()) << "sequence";
      messages[topic].push_back(
          {whole(at + 6, 8), nlohmann::json::parse(bytes_.substr(at + 22, end - at - 22))});
    } else if (opcode == 6) {
      ++chunks;
      chunk_begin_ = at + 32 + 8;  // times, size, crc, "", size
      EXPECT_EQ(whole(at + 32, 8), end - chunk_begin_);
      read(chunk_begin_, end, true);
    } else if (opcode == 7) {
      for (std::size_t entry = at + 6; entry < end; entry += 16, ++indexed) {
        const std::size_t message = chunk_begin_ + whole(entry + 8, 8);
        EXPECT_EQ(whole(message, 1), 5u) << "points at a message";
        EXPECT_EQ(whole(message + 9, 2), whole(at, 2)) << "of its channel";
        EXPECT_EQ(whole(message + 15, 8), whole(entry, 8)) << "at its time";
      }
    } else if (opcode == 8) {
      ++chunk_indexes;
      EXPECT_EQ(whole(whole(at + 16, 8), 1), 6u) << "points at a chunk";
    } else if (opcode == 11) {
      counted = whole(at, 8);
    } else if (opcode == 15) {
      data_end = record_at;
    } else if (opcode == 2) {
      summary_begin = whole(at, 8);
    }
  }
  std::string bytes_;
  std::map<std::uint64_t, std::string> schema_names_, topics_;
  std::size_t chunk_begin_ = 0;
};

}  // namespace twinrate
