#include "scope/server.hpp"

#include "core/load_part.hpp"

namespace twinrate::scope {

Server::Server(Api& api, const std::string& address, int port, double request_s) {
  static auto* const open = reinterpret_cast<Open*>(load_part("http"));
  http_.reset(open(api, {address, port, request_s, find_asset}));
}

}  // namespace twinrate::scope
