// The server of the page against requests that a browser would not send.
#include "scope/server.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <thread>

#include "core/config.hpp"

namespace twinrate::scope {
namespace {

// A connection to 127.0.0.1, closed at the end.
class Connection {
 public:
  explicit Connection(int port) : socket_(::socket(AF_INET, SOCK_STREAM, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    connected_ = ::connect(socket_, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0;
  }
  ~Connection() { ::close(socket_); }
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;
  bool connected() const { return connected_; }
  bool send(const std::string& text) const {
    return ::send(socket_, text.data(), text.size(), MSG_NOSIGNAL) ==
           static_cast<ssize_t>(text.size());
  }
  // What arrives until `enough` characters, the end, or the limit.
  std::string receive(std::size_t enough = SIZE_MAX, int limit_ms = 3000) const {
    std::string all;
    char piece[4096];
    pollfd descriptor{.fd = socket_, .events = POLLIN, .revents = 0};
    while (all.size() < enough && ::poll(&descriptor, 1, limit_ms) > 0) {
      const ssize_t count = ::recv(socket_, piece, sizeof piece, 0);
      if (count <= 0) break;
      all.append(piece, static_cast<std::size_t>(count));
    }
    return all;
  }
  bool closed_by_server(int limit_ms) const {
    pollfd descriptor{.fd = socket_, .events = POLLIN, .revents = 0};
    char byte = 0;
    return ::poll(&descriptor, 1, limit_ms) > 0 && ::recv(socket_, &byte, 1, 0) <= 0;
  }

 private:
  int socket_;
  bool connected_ = false;
};

class ScopeServer : public ::testing::Test {
 protected:
  std::string ask(const std::string& request) const {
    const Connection connection(server_->port());
    connection.send(request);
    return connection.receive();
  }
  std::string get(const std::string& path, const std::string& headers = "") const {
    return ask(fmt::format("GET {} HTTP/1.1\r\nHost: 127.0.0.1:{}\r\n{}\r\n", path, server_->port(),
                           headers));
  }
  std::string post(const std::string& path, const std::string& body) const {
    return ask(fmt::format("POST {} HTTP/1.1\r\nHost: 127.0.0.1:{}\r\nContent-Length: {}\r\n\r\n{}",
                           path, server_->port(), body.size(), body));
  }
  static int status(const std::string& answer) {
    return answer.size() > 12 ? std::atoi(answer.c_str() + 9) : 0;
  }

  std::shared_ptr<Recording> recording_ = std::make_shared<Recording>(1, 16 << 20);
  Sources sources_{recording_, "", 16 << 20};
  Api api_{sources_, nullptr, "test"};
  std::unique_ptr<Server> server_ = std::make_unique<Server>(api_, "127.0.0.1", 0);
};

TEST_F(ScopeServer, GivesThePageAndItsParts) {
  EXPECT_EQ(status(get("/")), 200);
  EXPECT_NE(get("/main.js").find("import"), std::string::npos);
  EXPECT_EQ(status(get("/uPlot.iife.min.js")), 200);
  EXPECT_EQ(status(get("/api/info")), 200);
  EXPECT_EQ(status(get("/api/tree")), 200);
}

TEST_F(ScopeServer, RefusesAnotherHostAndOrigin) {
  EXPECT_EQ(status(ask("GET /api/info HTTP/1.1\r\nHost: evil.example:80\r\n\r\n")), 403);
  EXPECT_EQ(status(ask("GET /api/info HTTP/1.1\r\n\r\n")), 403);
  EXPECT_EQ(status(get("/api/info", "Origin: http://evil.example\r\n")), 403);
  EXPECT_EQ(status(get("/api/info", "Origin: null\r\n")), 403);
  EXPECT_EQ(
      status(get("/api/info", fmt::format("Origin: http://127.0.0.1:{}\r\n", server_->port()))),
      200);
}

TEST_F(ScopeServer, GivesNoOtherFile) {
  for (const char* path :
       {"/../etc/passwd", "/..%2f..%2fetc/passwd", "/%2e%2e/server.cpp", "//etc/passwd",
        "/measurement_t.lcm", "/scope.html/../main.js", "/api/../../main.js"})
    EXPECT_NE(status(get(path)), 200) << path;
  for (const char* run : {"run:../a", "run:/etc", "run:", "file:///etc/passwd", "run:..%2f.."})
    EXPECT_EQ(status(get(fmt::format("/api/data?source={}&signals=a&from=0&to=1", run))), 400)
        << run;
}

TEST_F(ScopeServer, SaysWhatIsWrongWithARequest) {
  for (const char* path :
       {"/api/data?from=x", "/api/data?from=5&to=1", "/api/data?signals=a&to=99999999999",
        "/api/data?bucket=0", "/api/data?bucket=-4", "/api/stream?bucket=0",
        "/api/align?by=x&ghost=run:a"})
    EXPECT_EQ(status(get(path)), 400) << path;
  EXPECT_EQ(status(post("/api/trigger", "{\"mode\": \"sometimes\"}")), 400);
  EXPECT_EQ(status(post("/api/trigger", "not json")), 400);
  EXPECT_EQ(status(post("/api/trigger", "{\"mode\":\"normal\",\"signal\":\"a\",\"pre_share\":2}")),
            400);
  EXPECT_EQ(status(post("/api/trigger", "{\"mode\":\"normal\",\"signal\":5}")), 400);
  EXPECT_EQ(status(post("/api/request", "{\"kind\":\"start\"}")), 400);  // a log cannot be steered
  EXPECT_EQ(status(get("/api/data?signals=a&from=0&to=10")), 200);
}

TEST_F(ScopeServer, RefusesABodyThatDoesNotEnd) {
  EXPECT_EQ(status(post("/api/trigger", std::string(kMostBodyBytes + 1, 'x'))), 413);
  const Connection endless(server_->port());
  endless.send(fmt::format(
      "POST /api/trigger HTTP/1.1\r\nHost: 127.0.0.1:{}\r\nContent-Length: 9999999999\r\n\r\n",
      server_->port()));
  EXPECT_EQ(status(endless.receive()), 413);  // after kRequest_s
}

TEST_F(ScopeServer, ClosesConnectionsBeyondItsLimitAndRecovers) {
  const std::string stream =
      fmt::format("GET /api/stream HTTP/1.1\r\nHost: 127.0.0.1:{}\r\n\r\n", server_->port());
  const Connection page(server_->port());  // one that is open already
  page.send(stream);
  ASSERT_NE(page.receive(200).find("text/event-stream"), std::string::npos);
  {
    std::vector<std::unique_ptr<Connection>> crowd;
    int closed = 0;
    crowd.reserve(200);
    for (int i = 0; i < 200; ++i) crowd.push_back(std::make_unique<Connection>(server_->port()));
    for (const auto& one : crowd) closed += one->closed_by_server(0) || one->closed_by_server(20);
    EXPECT_GE(closed, 200 - static_cast<int>(kMostConnections));
    EXPECT_GT(page.receive(10).size(), 0u);  // the page goes on meanwhile
  }
  // On a slow machine some wait until an earlier one has timed out.
  EXPECT_GT(server_->refused(), 0);
  int last = 0;
  for (int i = 0; i < 100 && last != 200; ++i) {
    last = status(get("/api/info"));
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  EXPECT_EQ(last, 200);
}

TEST_F(ScopeServer, BeyondThisMachineNeedsTheToken) {
  server_ = std::make_unique<Server>(api_, "0.0.0.0", 0);
  const std::string url = server_->url();
  const std::string token = url.substr(url.find("token=") + 6);
  ASSERT_EQ(token.size(), 32u);
  EXPECT_EQ(status(get("/")), 403);
  EXPECT_EQ(status(get("/api/info")), 403);
  EXPECT_EQ(status(get("/api/info?token=" + std::string(32, '0'))), 403);
  EXPECT_EQ(status(get("/api/info?token=" + token)), 200);
  EXPECT_EQ(status(get("/?token=" + token)), 200);
}

TEST_F(ScopeServer, RefusesAPortThatIsTaken) {
  EXPECT_THROW(Server(api_, "127.0.0.1", server_->port()), BadInput);
}

}  // namespace
}  // namespace twinrate::scope
