// The MCAP container, https://mcap.dev/spec: records of an opcode, a 64-bit length and contents,
// all little-endian. Written here: Header; Schema, Channel, Message in chunks, packed and with the
// CRC of the unpacked bytes; a MessageIndex after each chunk; a summary (Schema, Channel, Statistics,
// ChunkIndex) for seeking. The CRCs of data and summary are 0: not available.
#include <fmt/format.h>
#include <lz4frame.h>
#include <zlib.h>
#include <zstd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>

#include "core/output_file.hpp"
#include "core/paths.hpp"
#include "export/message_json.hpp"
#include "export/sink.hpp"
#include "import/mcap_format.hpp"

namespace twinrate {
namespace {

using namespace mcap;

constexpr std::size_t kChunkBytes = 1 << 20;

class Bytes {
 public:
  template <class Whole>
  Bytes& number(Whole value) {
    for (std::size_t i = 0; i < sizeof(Whole); ++i)
      text_ += static_cast<char>(static_cast<std::uint64_t>(value) >> (8 * i));
    return *this;
  }
  Bytes& u16(std::size_t value) { return number(static_cast<std::uint16_t>(value)); }
  Bytes& u32(std::size_t value) { return number(static_cast<std::uint32_t>(value)); }
  Bytes& u64(std::size_t value) { return number(static_cast<std::uint64_t>(value)); }
  Bytes& raw(std::string_view text) {
    text_ += text;
    return *this;
  }
  Bytes& string(std::string_view text) { return u32(text.size()).raw(text); }
  const std::string& text() const { return text_; }

 private:
  std::string text_;
};

std::string record(Opcode opcode, const std::string& contents) {
  return Bytes().number(opcode).u64(contents.size()).raw(contents).text();
}

std::string packed(const std::string& compression, const std::string& text) {
  if (compression.empty()) return text;
  std::string out;
  std::size_t length = 0;
  if (compression == "zstd") {
    out.resize(ZSTD_compressBound(text.size()));
    length = ZSTD_compress(out.data(), out.size(), text.data(), text.size(), 1);
    if (ZSTD_isError(length)) throw std::runtime_error(ZSTD_getErrorName(length));
  } else {
    out.resize(LZ4F_compressFrameBound(text.size(), nullptr));
    length = LZ4F_compressFrame(out.data(), out.size(), text.data(), text.size(), nullptr);
    if (LZ4F_isError(length)) throw std::runtime_error(LZ4F_getErrorName(length));
  }
  out.resize(length);
  return out;
}

class McapSink final : public ExportSink {
 public:
  McapSink(const std::string& path, std::string compression)
      : part_(path),
        file_(std::fopen(part_.part_path().c_str(), "wb")),
        compression_(std::move(compression)) {
    if (!file_) part_.fail();
    put(kMagic);
    put(record(kHeader, Bytes().string("").string("twinrate " + revision()).text()));
  }
  ~McapSink() override {
    if (file_) std::fclose(file_);
  }
  void open(const std::string& stream, const Layout& layout) override {
    layouts_.push_back(layout);
    counts_.push_back(0);
    const std::size_t id = layouts_.size();  // from 1: schema 0 is none
    const std::string schema = record(kSchema, Bytes()
                                                   .u16(id)
                                                   .string("twinrate." + stream)
                                                   .string("jsonschema")
                                                   .string(message_schema(layout))
                                                   .text());
    const std::string channel =
        record(kChannelRecord, Bytes().u16(id).u16(id).string(stream).string("json").u32(0).text());
    chunk_ += schema + channel;
    summary_ += schema + channel;
  }
  void write(std::size_t stream, const Sample& sample) override {
    const auto t = static_cast<std::uint64_t>(std::max<std::int64_t>(0, sample.t_ns));
    index_[stream + 1].u64(t).u64(chunk_.size());
    chunk_ += record(kMessage, Bytes()
                                   .u16(stream + 1)
                                   .u32(counts_[stream]++)
                                   .number(t)
                                   .number(t)
                                   .raw(message_json(layouts_[stream], sample))
                                   .text());
    chunk_begin_ = std::min(chunk_begin_, t);
    chunk_end_ = std::max(chunk_end_, t);
    if (chunk_.size() > kChunkBytes) end_chunk();
  }
  void finish() override {
    end_chunk();
    put(record(kDataEnd, Bytes().u32(0).text()));
    const std::uint64_t summary_begin = at_;
    Bytes by_channel;
    std::uint64_t messages = 0;
    for (std::size_t i = 0; i < counts_.size(); messages += counts_[i++])
      by_channel.u16(i + 1).u64(counts_[i]);
    put(summary_);
    put(record(kStatistics, Bytes()
                                .number(messages)
                                .u16(layouts_.size())
                                .u32(layouts_.size())
                                .u32(0)
                                .u32(0)
                                .u32(chunks_)
                                .number(messages > 0 ? begin_ : 0)
                                .number(end_)
                                .string(by_channel.text())
                                .text()));
    put(chunk_indexes_);
    put(record(kFooter, Bytes().number(summary_begin).u64(0).u32(0).text()));
    put(kMagic);
    const bool closed = std::fclose(file_) == 0;
    file_ = nullptr;
    if (!closed) part_.fail();
    part_.finish();
  }

 private:
  void end_chunk() {
    if (chunk_.empty()) return;
    if (index_.empty()) chunk_begin_ = 0;
    const std::uint64_t chunk_at = at_;
    const std::string stored = packed(compression_, chunk_);
    const auto crc =
        crc32_z(0, reinterpret_cast<const unsigned char*>(chunk_.data()), chunk_.size());
    put(record(kChunk, Bytes()
                           .number(chunk_begin_)
                           .number(chunk_end_)
                           .u64(chunk_.size())
                           .u32(crc)
                           .string(compression_)
                           .u64(stored.size())
                           .raw(stored)
                           .text()));
    const std::uint64_t chunk_length = at_ - chunk_at, index_at = at_;
    Bytes offsets;
    for (const auto& [id, entries] : index_) {
      offsets.u16(id).number(at_);
      put(record(kMessageIndex, Bytes().u16(id).string(entries.text()).text()));
    }
    chunk_indexes_ += record(kChunkIndex, Bytes()
                                              .number(chunk_begin_)
                                              .number(chunk_end_)
                                              .number(chunk_at)
                                              .number(chunk_length)
                                              .string(offsets.text())
                                              .number(at_ - index_at)
                                              .string(compression_)
                                              .u64(stored.size())
                                              .u64(chunk_.size())
                                              .text());
    begin_ = std::min(begin_, chunk_begin_);
    end_ = std::max(end_, chunk_end_);
    ++chunks_;
    chunk_.clear();
    index_.clear();
    chunk_begin_ = UINT64_MAX;
    chunk_end_ = 0;
  }
  void put(std::string_view text) {
    if (std::fwrite(text.data(), 1, text.size(), file_) != text.size()) part_.fail();
    at_ += text.size();
  }

  PartFile part_;
  std::FILE* file_;
  std::string compression_;
  std::uint64_t at_ = 0;
  std::vector<Layout> layouts_;
  std::vector<std::uint32_t> counts_;  // messages of each stream
  std::string chunk_, summary_, chunk_indexes_;
  std::map<std::size_t, Bytes> index_;  // of the chunk, by channel: time and place of its messages
  std::uint64_t chunk_begin_ = UINT64_MAX, chunk_end_ = 0, begin_ = UINT64_MAX, end_ = 0;
  std::size_t chunks_ = 0;
};

}  // namespace

std::unique_ptr<ExportSink> make_mcap_sink(const std::string& path,
                                           const std::string& compression) {
  return std::make_unique<McapSink>(path, compression);
}

}  // namespace twinrate
