#include "stream/foxglove.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "core/config.hpp"
#include "core/load_part.hpp"
#include "export/message_json.hpp"
#include "stream/websockets_functions.hpp"

namespace twinrate {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t kMaxRequestBytes = 64 << 10;  // of a client's text
constexpr int kError = 2, kWarning = 1;             // levels of `status`
constexpr std::uint8_t kMessageData = 1;            // opcode of a binary message

const WebsocketsFunctions& websockets() {
  static const auto* const functions =
      static_cast<const WebsocketsFunctions*>(load_part("websockets"));
  return *functions;
}

int callback(lws* wsi, lws_callback_reasons reason, void*, void* bytes, std::size_t size) {
  auto* server =
      static_cast<FoxgloveServer*>(websockets().context_user(websockets().context_of(wsi)));
  return server ? server->on_event(wsi, reason, bytes, size) : 0;
}

const lws_protocols kProtocols[] = {{"foxglove.websocket.v1", callback, 0, 4096, 0, nullptr, 0},
                                    {nullptr, nullptr, 0, 0, 0, nullptr, 0}};

std::uint32_t id_of(Channel channel) {
  return static_cast<std::uint32_t>(channel) + 1;
}

std::string short_name(Channel channel) {
  return std::string(info(channel).name).substr(6);
}

template <class Message>
Layout layout_of() {
  Message message{};
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  Sample sample;
  Layout layout;
  read_sample(kChannelOf<Message>, bytes.data(), bytes.size(), sample, &layout);
  return layout;
}

template <class... Message>
std::string advertisement() {
  Json channels = Json::array();
  const auto add = [&](Channel channel, const Layout& layout) {
    channels.push_back({{"id", id_of(channel)},
                        {"topic", short_name(channel)},
                        {"encoding", "json"},
                        {"schemaName", "twinrate." + short_name(channel)},
                        {"schema", message_schema(layout)},
                        {"schemaEncoding", "jsonschema"}});
  };
  (add(kChannelOf<Message>, layout_of<Message>()), ...);
  return Json{{"op", "advertise"}, {"channels", channels}}.dump();
}

template <class Whole>
void append(std::string& bytes, Whole value) {
  for (std::size_t i = 0; i < sizeof value; ++i)
    bytes += static_cast<char>(static_cast<std::uint64_t>(value) >> (8 * i));
}

}  // namespace

FoxgloveServer::FoxgloveServer(const std::string& address, int port, std::size_t max_queue_bytes)
    : max_queue_bytes_(max_queue_bytes) {
  websockets().log_level(0, nullptr);
  lws_context_creation_info options{};
  options.port = port;
  options.iface = address.c_str();
  options.protocols = kProtocols;
  options.user = this;
  options.gid = static_cast<gid_t>(-1);
  options.uid = static_cast<uid_t>(-1);
  options.options = LWS_SERVER_OPTION_FAIL_UPON_UNABLE_TO_BIND;
  context_ = websockets().create_context(&options);
  if (!context_)
    throw BadInput(fmt::format(
        "{}:{}: not free, or no address of this machine; --port and --listen take others", address,
        port));
}

FoxgloveServer::~FoxgloveServer() {
  websockets().destroy_context(context_);
}

int FoxgloveServer::port() const {
  return websockets().listen_port(websockets().vhost(context_, "default"));
}

void FoxgloveServer::serve() {
  websockets().serve(context_, -1);
}

void FoxgloveServer::offer(Channel channel, const Layout& layout, const Sample& sample) {
  std::string text;
  for (auto& [wsi, client] : clients_)
    for (const auto& [subscription, wanted] : client.subscriptions) {
      if (wanted != channel) continue;
      if (text.empty()) text = message_json(layout, sample);
      std::string bytes(LWS_PRE, '\0');
      append(bytes, kMessageData);
      append(bytes, subscription);
      append(bytes, static_cast<std::uint64_t>(std::max<std::int64_t>(0, sample.t_ns)));
      bytes += text;
      if (client.queued_bytes + bytes.size() > max_queue_bytes_) {
        ++client.lost;
        ++lost_;
        continue;
      }
      client.queued_bytes += bytes.size();
      client.queue.emplace_back(true, std::move(bytes));
      websockets().call_when_writable(wsi);
    }
}

void FoxgloveServer::queue_text(Client& client, const std::string& text) {
  std::string bytes = std::string(LWS_PRE, '\0') + text;
  client.queued_bytes += bytes.size();
  client.queue.emplace_back(false, std::move(bytes));
}

void FoxgloveServer::say(Client& client, int level, const std::string& text) {
  if (client.queued_bytes <= max_queue_bytes_)
    queue_text(client, Json{{"op", "status"}, {"level", level}, {"message", text}}.dump());
}

void FoxgloveServer::greet(Client& client) {
  queue_text(client, Json{{"op", "serverInfo"},
                          {"name", "twinrate"},
                          {"capabilities", Json::array()},
                          {"supportedEncodings", Json::array()},
                          {"metadata", Json::object()}}
                         .dump());
  static const std::string channels =
      advertisement<measurement_t, truth_t, estimate_t, gain_t, reference_t, command_t, status_t,
                    event_t, manifest_t, request_t, reply_t>();
  queue_text(client, channels);
}

// {"op": "subscribe", "subscriptions": [{"id": 0, "channelId": 3}]}
// {"op": "unsubscribe", "subscriptionIds": [0]}
void FoxgloveServer::take(Client& client, const std::string& text) {
  const Json json = Json::parse(text, nullptr, false);
  const std::string op = json.is_object() && json.contains("op") && json["op"].is_string()
                             ? json["op"].get<std::string>()
                             : "";
  const auto id = [](const Json& value) -> std::int64_t {
    return value.is_number_integer() ? value.get<std::int64_t>() : -1;
  };
  const auto list = [&](const char* name) {
    return json.contains(name) && json[name].is_array() ? json[name] : Json::array();
  };
  if (op == "subscribe") {
    for (const Json& wanted : list("subscriptions")) {
      const std::int64_t subscription = wanted.is_object() ? id(wanted.value("id", Json())) : -1,
                         channel = wanted.is_object() ? id(wanted.value("channelId", Json())) : -1;
      if (subscription < 0 || subscription > UINT32_MAX || channel < 1 ||
          channel >= kChannelCount || client.subscriptions.size() >= kChannelCount)
        say(client, kError, "subscribe: no such channel, or too many subscriptions");
      else
        client.subscriptions[static_cast<std::uint32_t>(subscription)] =
            static_cast<Channel>(channel - 1);
    }
  } else if (op == "unsubscribe") {
    for (const Json& subscription : list("subscriptionIds"))
      client.subscriptions.erase(static_cast<std::uint32_t>(id(subscription)));
  } else {
    say(client, kError, "only subscribe and unsubscribe are understood");
  }
}

// False if the connection is gone.
bool FoxgloveServer::write(lws* wsi, Client& client) {
  while (!client.queue.empty() && !websockets().is_choked(wsi)) {
    auto& [binary, bytes] = client.queue.front();
    const std::size_t size = bytes.size() - LWS_PRE;
    auto* from = reinterpret_cast<unsigned char*>(bytes.data()) + LWS_PRE;
    if (websockets().write(wsi, from, size, binary ? LWS_WRITE_BINARY : LWS_WRITE_TEXT) <
        static_cast<int>(size))
      return false;
    sent_ += binary;
    client.queued_bytes -= bytes.size();
    client.queue.pop_front();
  }
  if (client.lost > client.lost_said && client.queued_bytes < max_queue_bytes_ / 2) {
    say(client, kWarning,
        fmt::format("{} messages lost: this client reads more slowly than the drive sends",
                    client.lost - client.lost_said));
    client.lost_said = client.lost;
  }
  if (!client.queue.empty()) websockets().call_when_writable(wsi);
  return true;
}

int FoxgloveServer::on_event(lws* wsi, int reason, const void* bytes, std::size_t size) {
  if (reason == LWS_CALLBACK_FILTER_PROTOCOL_CONNECTION) return clients_.size() >= kMaxClients;
  if (reason == LWS_CALLBACK_ESTABLISHED) {
    greet(clients_[wsi]);
    websockets().call_when_writable(wsi);
    return 0;
  }
  if (reason == LWS_CALLBACK_CLOSED) {
    clients_.erase(wsi);
    return 0;
  }
  const auto found = clients_.find(wsi);
  if (found == clients_.end()) return 0;
  Client& client = found->second;
  if (reason == LWS_CALLBACK_SERVER_WRITEABLE) return write(wsi, client) ? 0 : -1;
  if (reason != LWS_CALLBACK_RECEIVE) return 0;
  client.received.append(static_cast<const char*>(bytes), size);
  if (client.received.size() > kMaxRequestBytes) return -1;
  if (!websockets().is_final_fragment(wsi) || websockets().bytes_to_come(wsi) > 0) return 0;
  take(client, client.received);
  client.received.clear();
  websockets().call_when_writable(wsi);
  return 0;
}

}  // namespace twinrate
