// A websocket server for Foxglove (subprotocol foxglove.websocket.v1,
// github.com/foxglove/ws-protocol/blob/main/docs/spec.md).
//
// It advertises every channel with the JSON schema of the MCAP export. A client gets the messages
// of the channels to which it subscribes, stamped with the drive time. Nothing waits for a client:
// a message that does not fit into its queue of kMaxQueueBytes is lost for this client, counted,
// and reported to it in a `status` message. Any other message of a client than a subscription is
// answered with a `status`.
#pragma once
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <string>

#include "core/channels.hpp"
#include "export/fields.hpp"

struct lws;
struct lws_context;

namespace twinrate {

inline constexpr std::size_t kMaxQueueBytes = 4 << 20;  // of a client
inline constexpr std::size_t kMaxClients = 8;

class FoxgloveServer {
 public:
  // Port 0: a free one. Throws BadInput: the port is taken, `address` is none of this machine.
  FoxgloveServer(const std::string& address, int port,
                 std::size_t max_queue_bytes = kMaxQueueBytes);
  ~FoxgloveServer();
  FoxgloveServer(const FoxgloveServer&) = delete;
  FoxgloveServer& operator=(const FoxgloveServer&) = delete;

  int port() const;
  // Puts the message into the queue of every client that wants it.
  void offer(Channel channel, const Layout& layout, const Sample& sample);
  // Reads from the clients and writes to them without waiting.
  void serve();

  std::size_t clients() const { return clients_.size(); }
  std::int64_t sent() const { return sent_; }
  std::int64_t lost() const { return lost_; }

  // Events of libwebsockets, on the thread of serve().
  int on_event(lws* wsi, int reason, const void* bytes, std::size_t size);

 private:
  struct Client {
    std::map<std::uint32_t, Channel> subscriptions;  // by the client's id
    std::deque<std::pair<bool, std::string>> queue;  // binary; with room for the frame's header
    std::size_t queued_bytes = 0;
    std::int64_t lost = 0, lost_said = 0;
    std::string received;
  };
  void greet(Client& client);
  void take(Client& client, const std::string& text);
  void queue_text(Client& client, const std::string& text);
  void say(Client& client, int level, const std::string& text);
  bool write(lws* wsi, Client& client);

  std::size_t max_queue_bytes_;
  lws_context* context_ = nullptr;
  std::map<lws*, Client> clients_;
  std::int64_t sent_ = 0, lost_ = 0;
};

}  // namespace twinrate
