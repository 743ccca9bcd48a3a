// Tags: a message from a process of a launched set proves that its sender has the run's token.
//
//   tag = SipHash-2-4(key = token, channel, zero byte, encoded message without its last 8 bytes)
//
// The tag is the last field of every message. LCM itself has no authentication: everyone who
// reaches the multicast group can send. The token is a file of the run directory that only its
// owner can read; it is never on a command line. A tag shows that a sender with the token made the
// message, not that the message is new: sequence numbers and sessions are checked as well. Nothing
// is encrypted.
// Source: Aumasson and Bernstein 2012, SipHash; libsodium crypto_shorthash.
#pragma once
#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace twinrate {

inline constexpr const char* kTokenFile = "token";  // in the run directory
inline constexpr std::size_t kTagBytes = 8;         // at the end of every message

using Token = std::array<std::uint8_t, 16>;

// Of a token file. Throws BadInput if it cannot be read, holds no token, or others may read it.
Token read_token(const std::string& path);

// A file with a new token, readable for its owner alone; removed with this object. Throws BadInput if
// the name is taken, std::runtime_error if the file cannot be written.
class TokenFile {
 public:
  explicit TokenFile(std::string path);
  ~TokenFile();
  TokenFile(const TokenFile&) = delete;
  TokenFile& operator=(const TokenFile&) = delete;
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

class Tagger {
 public:
  explicit Tagger(const Token& token) : token_(token) {}
  // Puts the tag into the last 8 bytes of an encoded message.
  void put(std::string_view channel, std::uint8_t* bytes, std::size_t size);
  bool is_genuine(std::string_view channel, const std::uint8_t* bytes, std::size_t size);

 private:
  std::uint64_t tag_of(std::string_view channel, const std::uint8_t* bytes, std::size_t size);

  Token token_;
  std::vector<std::uint8_t> hashed_;
};

}  // namespace twinrate
