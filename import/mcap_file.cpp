#include "import/mcap_file.hpp"

#include <fmt/format.h>
#include <lz4frame.h>
#include <zlib.h>
#include <zstd.h>

#include <cstring>
#include <fstream>
#include <map>
#include <memory>

#include "core/config.hpp"
#include "import/mcap_format.hpp"

namespace twinrate {
namespace {

struct McapDamage {
  std::string what;
};

// Fields of a record, one after the other.
class Fields {
 public:
  explicit Fields(std::string_view bytes) : bytes_(bytes) {}
  template <class Whole>
  Whole number() {
    Whole value;
    std::memcpy(&value, take(sizeof value).data(), sizeof value);
    return value;
  }
  std::string_view text() { return take(number<std::uint32_t>()); }
  std::string_view take(std::uint64_t size) {
    if (size > bytes_.size())
      throw McapDamage{fmt::format("{} bytes are missing in a record", size - bytes_.size())};
    const std::string_view taken = bytes_.substr(0, static_cast<std::size_t>(size));
    bytes_.remove_prefix(taken.size());
    return taken;
  }
  std::string_view rest() const { return bytes_; }

 private:
  std::string_view bytes_;
};

// `size`: that of the unpacked bytes, which the caller has limited.
void unpack_zstd(std::string_view packed, std::size_t size, std::string& out) {
  out.resize(size);
  const std::size_t got = ZSTD_decompress(out.data(), size, packed.data(), packed.size());
  if (ZSTD_isError(got) || got != size) throw McapDamage{"a chunk cannot be unpacked (zstd)"};
}

void unpack_lz4(std::string_view packed, std::size_t size, std::string& out) {
  LZ4F_dctx* raw = nullptr;
  if (LZ4F_isError(LZ4F_createDecompressionContext(&raw, LZ4F_VERSION)))
    throw McapDamage{"a chunk cannot be unpacked (lz4)"};
  const std::unique_ptr<LZ4F_dctx, LZ4F_errorCode_t (*)(LZ4F_dctx*)> context(
      raw, LZ4F_freeDecompressionContext);
  out.resize(size);
  std::size_t done = 0, result = 1;
  while (result != 0) {
    std::size_t to = size - done, from = packed.size();
    result = LZ4F_decompress(raw, out.data() + done, &to, packed.data(), &from, nullptr);
    if (LZ4F_isError(result) || (to == 0 && from == 0))
      throw McapDamage{"a chunk cannot be unpacked (lz4)"};
    done += to;
    packed.remove_prefix(from);
  }
  if (done != size) throw McapDamage{"a chunk has another length than its header says (lz4)"};
}

class McapReader {
 public:
  explicit McapReader(const std::function<void(const McapMessage&)>& take) : take_(take) {}

  // Returns false at the end of the data.
  bool record(std::uint8_t opcode, std::string_view bytes, bool in_chunk) {
    Fields f(bytes);
    if (opcode == mcap::kSchema) {
      const auto id = f.number<std::uint16_t>();
      schemas_[id] = f.text();
    } else if (opcode == mcap::kChannelRecord) {
      const auto id = f.number<std::uint16_t>();
      Channel& c = channels_[id];
      c.schema = f.number<std::uint16_t>();
      c.topic = f.text();
      c.encoding = f.text();
    } else if (opcode == mcap::kMessage) {
      const auto channel = channels_.find(f.number<std::uint16_t>());
      if (channel == channels_.end()) throw McapDamage{"a message of a channel that is not there"};
      f.take(4 + 8 + 8);  // sequence, log time, publish time
      take_({channel->second.topic, schemas_[channel->second.schema], channel->second.encoding,
             f.rest()});
    } else if (opcode == mcap::kChunk) {
      if (in_chunk) throw McapDamage{"a chunk within a chunk"};
      chunk(f);
    }
    return opcode != mcap::kDataEnd && opcode != mcap::kFooter;
  }

 private:
  struct Channel {
    std::uint16_t schema = 0;
    std::string topic, encoding;
  };

  void chunk(Fields& f) {
    f.take(8 + 8);  // times
    const auto size = f.number<std::uint64_t>();
    const auto crc = f.number<std::uint32_t>();
    const std::string_view compression = f.text();
    const std::string_view stored = f.take(f.number<std::uint64_t>());
    if (size > kMaxChunkBytes)
      throw McapDamage{
          fmt::format("a chunk of {} MB; at most {} MB", size >> 20, kMaxChunkBytes >> 20)};
    std::string_view records = stored;
    if (compression == "zstd" || compression == "lz4") {
      (compression == "zstd" ? unpack_zstd : unpack_lz4)(stored, static_cast<std::size_t>(size),
                                                         unpacked_);
      records = unpacked_;
    } else if (!compression.empty()) {
      throw McapDamage{"a chunk has a compression other than zstd or lz4"};
    }
    const auto* bytes = reinterpret_cast<const unsigned char*>(records.data());
    if (crc != 0 && crc != crc32_z(0, bytes, records.size()))
      throw McapDamage{"a chunk has another check sum than its header says"};
    for (Fields in(records); !in.rest().empty();) {
      const auto opcode = in.number<std::uint8_t>();
      record(opcode, in.take(in.number<std::uint64_t>()), true);
    }
  }

  const std::function<void(const McapMessage&)>& take_;
  std::map<std::uint16_t, std::string> schemas_;
  std::map<std::uint16_t, Channel> channels_;
  std::string unpacked_;
};

}  // namespace

void read_mcap(const std::string& path, const std::function<void(const McapMessage&)>& take,
               const std::function<void(double)>& progress) {
  std::ifstream in(path, std::ios::binary | std::ios::ate);
  if (!in) throw BadInput(fmt::format("{}: no such file", path));
  const auto size = static_cast<std::uint64_t>(in.tellg());
  in.seekg(0);
  std::string bytes(mcap::kMagic.size(), '\0');
  if (!in.read(bytes.data(), static_cast<std::streamsize>(bytes.size())) || bytes != mcap::kMagic)
    throw BadInput(fmt::format("{}: not an MCAP file", path));
  McapReader reader(take);
  try {
    for (std::uint64_t at = bytes.size();;) {
      char head[9];
      if (size - at < sizeof head || !in.read(head, sizeof head))
        throw McapDamage{"it ends before its data end"};
      std::uint64_t length = 0;
      std::memcpy(&length, head + 1, sizeof length);
      at += sizeof head;
      if (length > size - at) throw McapDamage{"it ends within a record"};
      if (length > kMaxChunkBytes) throw McapDamage{"a record of more than 256 MB"};
      bytes.resize(static_cast<std::size_t>(length));
      if (!in.read(bytes.data(), static_cast<std::streamsize>(length)))
        throw McapDamage{"it cannot be read"};
      at += length;
      if (!reader.record(static_cast<std::uint8_t>(head[0]), bytes, false)) return;
      if (progress) progress(static_cast<double>(at) / static_cast<double>(size));
    }
  } catch (const McapDamage& damage) {
    throw BadInput(fmt::format("{}: damaged MCAP file: {}", path, damage.what));
  }
}

}  // namespace twinrate
