#include "core/message_tag.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sodium.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <stdexcept>

#include "core/config.hpp"
#include "core/lcm_socket.hpp"
#include "core/output_file.hpp"

namespace twinrate {
namespace {

static_assert(crypto_shorthash_KEYBYTES == Token{}.size());
static_assert(crypto_shorthash_BYTES == kTagBytes);
constexpr std::size_t kHexDigits = 2 * Token{}.size();

}  // namespace

Token read_token(const std::string& path) {
  struct stat facts {};
  if (stat(path.c_str(), &facts) != 0)
    throw BadInput(fmt::format("{}: {}: no run with this directory is on, or it is another user's",
                               path, std::strerror(errno)));
  if (!S_ISREG(facts.st_mode))  // a pipe would be waited for
    throw BadInput(fmt::format("{}: is not a plain file", path));
  if ((facts.st_mode & (S_IRWXG | S_IRWXO)) != 0)
    throw BadInput(fmt::format("{}: others may read it; only mode 0600 is allowed", path));
  std::ifstream file(path);
  std::string text;
  Token token{};
  std::size_t size = 0;
  if (!(file >> text) || text.size() != kHexDigits ||
      sodium_hex2bin(token.data(), token.size(), text.data(), text.size(), nullptr, &size,
                     nullptr) != 0 ||
      size != token.size())
    throw BadInput(fmt::format("{}: holds no token: {} hexadecimal digits", path, kHexDigits));
  return token;
}

// Written under another name: who finds the file finds the whole token.
TokenFile::TokenFile(std::string path) : path_(std::move(path)) {
  if (sodium_init() < 0) throw std::runtime_error("libsodium cannot be initialised");
  Token token{};
  randombytes_buf(token.data(), token.size());
  std::array<char, kHexDigits + 1> text{};
  sodium_bin2hex(text.data(), text.size(), token.data(), token.size());
  text.back() = '\n';
  std::string part = path_ + ".XXXXXX";
  const FileDescriptor file(mkostemp(part.data(), O_CLOEXEC));  // mode 0600
  if (file.get() >= 0 &&
      write(file.get(), text.data(), text.size()) == static_cast<ssize_t>(text.size()) &&
      rename_to_free_name(part, path_))
    return;
  const int why = errno;
  if (file.get() >= 0) unlink(part.c_str());
  if (why == EEXIST) throw BadInput(path_ + ": exists and is not overwritten");
  throw std::runtime_error(fmt::format("{}: cannot be written: {}", path_, std::strerror(why)));
}

TokenFile::~TokenFile() {
  unlink(path_.c_str());
}

std::uint64_t Tagger::tag_of(std::string_view channel, const std::uint8_t* bytes,
                             std::size_t size) {
  hashed_.assign(channel.begin(), channel.end());
  hashed_.push_back(0);
  hashed_.insert(hashed_.end(), bytes, bytes + size - kTagBytes);
  std::array<std::uint8_t, kTagBytes> hash{};
  crypto_shorthash(hash.data(), hashed_.data(), hashed_.size(), token_.data());
  std::uint64_t tag = 0;
  for (const std::uint8_t byte : hash) tag = tag << 8 | byte;
  return tag;
}

void Tagger::put(std::string_view channel, std::uint8_t* bytes, std::size_t size) {
  const std::uint64_t tag = tag_of(channel, bytes, size);
  for (std::size_t i = 0; i < kTagBytes; ++i)
    bytes[size - kTagBytes + i] = static_cast<std::uint8_t>(tag >> (56 - 8 * i));
}

bool Tagger::is_genuine(std::string_view channel, const std::uint8_t* bytes, std::size_t size) {
  if (size < kTagBytes) return false;
  std::uint64_t found = 0;
  for (std::size_t i = size - kTagBytes; i < size; ++i) found = found << 8 | bytes[i];
  return found == tag_of(channel, bytes, size);
}

}  // namespace twinrate
