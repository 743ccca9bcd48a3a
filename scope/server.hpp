// HTTP in front of scope::Api: the page's files, /api/, and server-sent events.
//
// Who may ask: the Host header has to be an address of this server, an Origin header one of its
// pages; beyond 127.0.0.1 every request carries the token. Files are those of the program, by name.
// A connection is one request. More connections than kMostConnections are closed at once; a request
// has kRequest_s to arrive whole and kMostBodyBytes.
#pragma once
#include <memory>
#include <string>

#include "scope/api.hpp"

namespace twinrate::scope {

inline constexpr std::size_t kMostConnections = 32, kMostBodyBytes = 64 << 10;
inline constexpr double kRequest_s = 2, kFramesPerSecond = 25;

class Server {
 public:
  // `address`: 127.0.0.1, or an address of this machine, then with a token; `port` 0: any. Throws
  // BadInput where it cannot listen there.
  Server(Api& api, const std::string& address, int port, double request_s = kRequest_s);
  ~Server();
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;

  // What a browser opens, with the token.
  std::string url() const;
  int port() const;
  // For how many requests there was no place.
  std::int64_t refused() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace twinrate::scope
