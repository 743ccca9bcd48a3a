// The streams against clients of their own: the datagrams that PlotJuggler reads, and the websocket
// protocol of Foxglove. A client that does not read loses messages, and is told.
#include <arpa/inet.h>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <nlohmann/json.hpp>

#include "core/config.hpp"
#include "core/signals_io.hpp"
#include "stream/foxglove.hpp"
#include "stream/plotjuggler.hpp"

namespace twinrate {
namespace {

using Json = nlohmann::json;

struct Message {
  Channel channel = Channel::kEstimate;
  Layout layout;
  Sample sample;
};

template <class Wire>
Message message_of(Wire wire) {
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(wire.getEncodedSize()));
  wire.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  Message m{.channel = kChannelOf<Wire>};
  EXPECT_TRUE(read_sample(m.channel, bytes.data(), bytes.size(), m.sample, &m.layout));
  return m;
}

Message estimate(std::int64_t k) {
  estimate_t e{};
  e.seq = k;
  e.t_ns = k * 200'000;
  e.omega_m_rad_s = 41.25 + static_cast<double>(k);
  e.n_x = 4;
  e.n_y = 2;
  e.x_hat = {0.1, 0.2, std::nan(""), 0.4};
  e.innov = {1, 2};
  e.host_ns = 9'007'199'254'740'993;  // no double
  return message_of(e);
}

TEST(Plotjuggler, ADatagramIsDriveTimeAndNamedNumbers) {
  const Message m = estimate(5);
  const auto datagrams = plotjuggler_datagrams(m.channel, m.layout, m.sample);
  ASSERT_EQ(datagrams.size(), 1u);
  const Json json = Json::parse(datagrams[0]);
  EXPECT_EQ(json["timestamp"], 0.001);
  EXPECT_EQ(json["ESTIMATE"]["seq"], 5);
  EXPECT_EQ(json["ESTIMATE"]["omega_m_rad_s"], 46.25);
  EXPECT_EQ(json["ESTIMATE"]["x_hat[1]"], 0.2);
  EXPECT_FALSE(json["ESTIMATE"].contains("x_hat[2]")) << "not a number";
  EXPECT_EQ(json["ESTIMATE"]["host_ns"].get<std::int64_t>(), 9'007'199'254'740'993);
}

// PlotJuggler reads 2048 bytes of a datagram.
TEST(Plotjuggler, ALongMessageIsSentInParts) {
  gain_t g{};
  g.seq = 3;
  g.n_x = 4;
  g.n_y = 2;
  g.n_K = 8;
  g.K.assign(8, 1.0 / 3);
  g.n_P = 16;
  g.P.assign(16, 2.0 / 3);
  g.n_speeds = 8;
  g.at_omega_m_rad_s.assign(8, 1.0 / 7);
  g.n_K_at = 64;
  g.K_at.assign(64, 1.0 / 9);
  const Message m = message_of(g);
  const auto datagrams = plotjuggler_datagrams(m.channel, m.layout, m.sample);
  EXPECT_GT(datagrams.size(), 1u);
  std::size_t members = 0;
  for (const std::string& text : datagrams) {
    EXPECT_LE(text.size(), 2048u);
    const Json json = Json::parse(text);
    EXPECT_TRUE(json.contains("timestamp"));
    members += json["GAIN"].size() - 1;  // less seq
  }
  EXPECT_EQ(members, m.sample.numbers.size());
}

// A name that no message has would be an empty curve.
TEST(Plotjuggler, TheLayoutNamesFieldsOfMessages) {
  const std::string xml = plotjuggler_layout();
  std::string fields;
  const auto add = [&](const Message& m) {
    for (const Field& f : m.layout.numbers)
      fields += fmt::format("\"/{}/{}\"", std::string(info(m.channel).name).substr(6), f.name);
  };
  add(message_of(truth_t{}));
  add(message_of(estimate_t{}));
  add(message_of(reference_t{}));
  add(message_of(measurement_t{}));
  int curves = 0;
  for (std::size_t at = 0; (at = xml.find("curve name=", at)) != std::string::npos; ++curves) {
    at += 11;
    const std::string name = xml.substr(at, xml.find('"', at + 1) - at + 1);
    EXPECT_NE(fields.find(name), std::string::npos) << name;
  }
  EXPECT_EQ(curves, 10);
}

class Socket {
 public:
  Socket(int type, int port, bool listen) : fd_(socket(AF_INET, type, 0)) {
    address_.sin_family = AF_INET;
    address_.sin_port = htons(static_cast<std::uint16_t>(port));
    address_.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    auto* to = reinterpret_cast<sockaddr*>(&address_);
    socklen_t size = sizeof address_;
    EXPECT_EQ(listen ? bind(fd_, to, size) : connect(fd_, to, size), 0);
    getsockname(fd_, reinterpret_cast<sockaddr*>(&own_), &size);
  }
  ~Socket() { close(fd_); }
  Socket(const Socket&) = delete;
  Socket& operator=(const Socket&) = delete;
  int port() const { return ntohs(own_.sin_port); }
  int fd() const { return fd_; }

 private:
  int fd_;
  sockaddr_in address_{}, own_{};
};

TEST(Plotjuggler, EveryDatagramArrivesAndAMissingReaderIsCounted) {
  const Message m = estimate(1);
  int port = 0;
  {
    const Socket reader(SOCK_DGRAM, 0, true);
    port = reader.port();
    PlotjugglerSender sender("127.0.0.1", port);
    for (int k = 0; k < 20; ++k) sender.send(m.channel, m.layout, m.sample);
    char bytes[2048];
    for (int k = 0; k < 20; ++k) {
      const auto got = recv(reader.fd(), bytes, sizeof bytes, MSG_DONTWAIT);
      ASSERT_GT(got, 0);
      EXPECT_TRUE(Json::accept(std::string(bytes, static_cast<std::size_t>(got))));
    }
    EXPECT_EQ(sender.sent(), 20);
    EXPECT_EQ(sender.lost() + sender.unheard(), 0);
  }
  PlotjugglerSender alone("127.0.0.1", port);
  for (int k = 0; k < 20; ++k) alone.send(m.channel, m.layout, m.sample);
  EXPECT_GT(alone.unheard(), 0);
  EXPECT_THROW(PlotjugglerSender("no address", 9870), BadInput);
}

// A client on the same thread: every wait for bytes lets the server work.
class Client {
 public:
  explicit Client(FoxgloveServer& server)
      : server_(server), socket_(SOCK_STREAM, server.port(), false) {
    put("GET / HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n"
        "Sec-WebSocket-Protocol: foxglove.websocket.v1\r\n\r\n");
    while (bytes_.find("\r\n\r\n") == std::string::npos && read()) {
    }
    answer_ = bytes_.substr(0, bytes_.find("\r\n\r\n"));
    bytes_.erase(0, answer_.size() + 4);
  }
  const std::string& answer() const { return answer_; }
  void send(const Json& json) { send_text(json.dump()); }
  void send_text(const std::string& text) {
    std::string frame = "\x81";
    if (text.size() < 126) {
      frame += static_cast<char>(0x80 | text.size());
    } else {
      frame += static_cast<char>(0x80 | 126);
      frame += static_cast<char>(text.size() >> 8);
      frame += static_cast<char>(text.size());
    }
    const char mask[] = {1, 2, 3, 4};
    frame.append(mask, 4);
    for (std::size_t i = 0; i < text.size(); ++i) frame += static_cast<char>(text[i] ^ mask[i % 4]);
    put(frame);
  }
  struct Frame {
    int opcode = 0;  // 1: text, 2: binary; 0: none came
    std::string data;
  };
  Frame next() {
    for (;;) {
      if (bytes_.size() >= 2) {
        const auto byte = [&](std::size_t i) {
          return static_cast<std::uint64_t>(static_cast<unsigned char>(bytes_[i]));
        };
        std::uint64_t size = byte(1) & 127;
        std::size_t head = 2;
        const std::size_t more = size == 126 ? 2 : size == 127 ? 8 : 0;
        if (bytes_.size() >= head + more) {
          if (more > 0) size = 0;
          for (std::size_t i = 0; i < more; ++i) size = size << 8 | byte(head + i);
          head += more;
          if (bytes_.size() >= head + size) {
            const Frame frame{static_cast<int>(byte(0) & 15), bytes_.substr(head, size)};
            bytes_.erase(0, head + size);
            return frame;
          }
        }
      }
      if (!read()) return {};
    }
  }
  // False if the server sends nothing more.
  bool read() {
    for (int i = 0; i < 20; ++i) {
      server_.serve();
      char bytes[65536];
      const auto got = recv(socket_.fd(), bytes, sizeof bytes, MSG_DONTWAIT);
      if (got == 0) return false;
      if (got > 0) {
        bytes_.append(bytes, static_cast<std::size_t>(got));
        return true;
      }
    }
    return false;
  }

 private:
  void put(const std::string& text) {
    EXPECT_EQ(::send(socket_.fd(), text.data(), text.size(), 0), static_cast<ssize_t>(text.size()));
    for (int i = 0; i < 10; ++i) server_.serve();
  }
  FoxgloveServer& server_;
  Socket socket_;
  std::string bytes_, answer_;
};

std::uint64_t whole(const std::string& bytes, std::size_t at, int size) {
  std::uint64_t value = 0;
  for (int i = size; i-- > 0;)
    value = value << 8 | static_cast<unsigned char>(bytes[at + static_cast<std::size_t>(i)]);
  return value;
}

TEST(Foxglove, AClientSubscribesAndGetsMessagesOfItsSchema) {
  FoxgloveServer server("127.0.0.1", 0);
  Client client(server);
  EXPECT_TRUE(client.answer().starts_with("HTTP/1.1 101")) << client.answer();
  EXPECT_NE(client.answer().find("foxglove.websocket.v1"), std::string::npos) << client.answer();
  EXPECT_NE(client.answer().find("s3pPLMBiTxaQ9kYGzzhZRbK+xOo="), std::string::npos) << "RFC 6455";
  const Json hello = Json::parse(client.next().data);
  EXPECT_EQ(hello["op"], "serverInfo");
  const Json offer = Json::parse(client.next().data);
  EXPECT_EQ(offer["op"], "advertise");
  ASSERT_EQ(offer["channels"].size(), static_cast<std::size_t>(kChannelCount - 1)) << "all but ACK";
  Json channel;
  for (const Json& c : offer["channels"])
    if (c["topic"] == "ESTIMATE") channel = c;
  ASSERT_EQ(channel["encoding"], "json");
  EXPECT_EQ(channel["schemaName"], "twinrate.ESTIMATE");
  const Json schema = Json::parse(channel["schema"].get<std::string>());
  client.send(
      {{"op", "subscribe"}, {"subscriptions", {{{"id", 17}, {"channelId", channel["id"]}}}}});
  const Message m = estimate(9), other = message_of(truth_t{});
  server.offer(other.channel, other.layout, other.sample);
  server.offer(m.channel, m.layout, m.sample);
  const auto frame = client.next();
  ASSERT_EQ(frame.opcode, 2);
  EXPECT_EQ(whole(frame.data, 0, 1), 1u);
  EXPECT_EQ(whole(frame.data, 1, 4), 17u);
  EXPECT_EQ(whole(frame.data, 5, 8), 1'800'000u) << "drive time, ns";
  const Json body = Json::parse(frame.data.substr(13));
  EXPECT_EQ(body["omega_m_rad_s"], 50.25);
  EXPECT_TRUE(body["x_hat"][2].is_null());
  for (const auto& [name, value] : body.items())
    EXPECT_TRUE(schema["properties"].contains(name)) << name;
  client.send({{"op", "unsubscribe"}, {"subscriptionIds", {17}}});
  server.offer(m.channel, m.layout, m.sample);
  EXPECT_EQ(client.next().opcode, 0);
  EXPECT_EQ(server.sent(), 1);
}

TEST(Foxglove, AClientThatDoesNotReadLosesMessagesAndIsToldHowMany) {
  constexpr std::size_t kQueue = 64 << 10;
  FoxgloveServer server("127.0.0.1", 0, kQueue);
  Client slow(server), quick(server);
  for (Client* client : {&slow, &quick}) {
    client->next();
    client->next();
    client->send({{"op", "subscribe"},
                  {"subscriptions",
                   {{{"id", 1}, {"channelId", static_cast<int>(Channel::kEstimate) + 1}}}}});
  }
  const Message m = estimate(1);
  constexpr int kMessages = 40000;  // 16 MB: more than the sockets hold
  int read_quickly = 0;
  for (int k = 0; k < kMessages; ++k) {
    server.offer(m.channel, m.layout, m.sample);
    if (k % 20 == 0) server.serve();
    while (quick.next().opcode == 2 && ++read_quickly % 50 != 0) {
    }
    if (server.lost() > 100) break;
  }
  ASSERT_GT(server.lost(), 100);
  const std::int64_t lost = server.lost();
  int got = 0;
  std::int64_t said = 0;
  for (auto frame = slow.next(); frame.opcode != 0; frame = slow.next()) {
    if (frame.opcode == 2) {
      ++got;
      continue;
    }
    const Json status = Json::parse(frame.data);
    EXPECT_EQ(status["op"], "status");
    said += std::stoll(status["message"].get<std::string>());
  }
  EXPECT_GT(got, 0);
  EXPECT_EQ(said, lost);
}

TEST(Foxglove, NonsenseIsAnsweredAndTheOthersGoOn) {
  FoxgloveServer server("127.0.0.1", 0);
  Client client(server);
  client.next();
  client.next();
  for (const char* text :
       {"no json", "{}", "[]", "{\"op\":3}", "{\"op\":\"subscribe\",\"subscriptions\":[7]}",
        "{\"op\":\"subscribe\",\"subscriptions\":[{\"id\":-1,\"channelId\":99}]}"}) {
    client.send_text(text);
    const auto frame = client.next();
    ASSERT_EQ(frame.opcode, 1) << text;
    EXPECT_EQ(Json::parse(frame.data)["op"], "status") << text;
  }
  EXPECT_EQ(server.clients(), 1u);
  EXPECT_THROW(FoxgloveServer("127.0.0.1", server.port()), BadInput);
}

}  // namespace
}  // namespace twinrate
