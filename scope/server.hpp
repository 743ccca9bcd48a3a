// HTTP in front of scope::Api: the page's files, /api/, and server-sent events.
//
// Accepted requests: the Host header names an address of this server, an Origin header one of its
// pages; beyond 127.0.0.1 every request carries the token. Files are found by name among those of
// the program. A connection is one request. Connections beyond kMostConnections are closed at
// once; a request must arrive completely within kRequest_s and may have kMostBodyBytes.
#pragma once
#include <memory>
#include <string>

#include "scope/api.hpp"
#include "scope/assets.hpp"

namespace twinrate::scope {

inline constexpr std::size_t kMostConnections = 32, kMostBodyBytes = 64 << 10;
inline constexpr double kRequest_s = 2, kFramesPerSecond = 25;

class Server {
 public:
  // `address`: 127.0.0.1, or an address of this machine, then with a token; `port` 0: any. Throws
  // BadInput if it cannot listen there.
  Server(Api& api, const std::string& address, int port, double request_s = kRequest_s);

  // Address for a browser, with the token.
  std::string url() const { return http_->url(); }
  int port() const { return http_->bound_port(); }
  // Number of connections that were refused for lack of a thread.
  std::int64_t refused() const { return http_->refused(); }

  // The part `http` (core/load_part.hpp).
  struct Http {
    virtual ~Http() = default;
    virtual std::string url() const = 0;
    virtual int bound_port() const = 0;
    virtual std::int64_t refused() const = 0;
  };
  using FindAsset = const Asset* (*)(std::string_view name);
  struct Settings {
    std::string address;
    int port = 0;
    double request_s = kRequest_s;
    FindAsset find_asset = nullptr;
  };
  using Open = Http*(Api& api, const Settings& settings);

 private:
  std::unique_ptr<Http> http_;
};

}  // namespace twinrate::scope
