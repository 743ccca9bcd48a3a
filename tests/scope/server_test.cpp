// The server of the page against requests that a browser would not send.
#include "scope/server.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <thread>

#include "core/config.hpp"
#include "core/reason.hpp"
#include "core/signals_io.hpp"
#include "model/signals.hpp"

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
  template <class Message>
  void take(const Message& message) const {
    std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
    message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
    recording_->take(kChannelOf<Message>, bytes.data(), bytes.size(),
                     *read_header(bytes.data(), bytes.size()), 0);
  }
  static int status(const std::string& answer) {
    return answer.size() > 12 ? std::atoi(answer.c_str() + 9) : 0;
  }

  std::shared_ptr<Recording> recording_ = std::make_shared<Recording>(1, 16 << 20);
  Sources sources_{recording_, "", 16 << 20};
  Traces traces_{"", ""};
  Api api_{sources_, nullptr, "test", traces_};
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

// A request that never ends is closed at the limit of its size, long before its deadline.
TEST_F(ScopeServer, ClosesARequestThatIsLongerThanItsLimit) {
  const Server patient(api_, "127.0.0.1", 0, 600);
  std::string heads;
  while (heads.size() < 8 * kMostBodyBytes) heads += "X-A: " + std::string(100, 'a') + "\r\n";
  for (const auto& [start, more] :
       {std::pair<std::string, std::string>("POST /api/trigger", heads),
        {"POST /api/trigger",
         "Content-Length: 9999999999\r\n\r\n" + std::string(8 * kMostBodyBytes, 'x')}}) {
    const Connection endless(patient.port());
    endless.send(
        fmt::format("{} HTTP/1.1\r\nHost: 127.0.0.1:{}\r\n{}", start, patient.port(), more));
    endless.receive(SIZE_MAX, 50'000);
    EXPECT_TRUE(endless.closed_by_server(0));
  }
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
  EXPECT_EQ(status(get("/trace?id=1")), 403);
  EXPECT_EQ(status(get("/api/info.js")), 403);
  EXPECT_EQ(status(get("/main.js")), 200);
}

// What is not measured is no number of a drive log, whatever its field holds.
TEST_F(ScopeServer, ADriveLogHoldsWhatWasMeasured) {
  Measurement m;
  m.signals = kPhaseCurrents | kVoltage | kPosition;
  for (m.k = 0; m.k < 6; ++m.k) {
    m.u_alphabeta = {static_cast<double>(m.k), 0};
    if (m.k != 3) take(to_wire(m, 7));
  }
  const auto csv = get("/api/csv?trace=1&from=0&to=6");
  // The voltage of row k is in message k + 1: 2 has none, 3 did not come.
  EXPECT_NE(csv.find("t,i_a,i_b,i_c,u_alpha,u_beta,theta_m\n0,0,0,0,1,0,0\n"), std::string::npos)
      << csv;
  const std::string rows = csv.substr(csv.find("theta_m\n") + 8);
  EXPECT_EQ(std::count(rows.begin(), rows.end(), '\n'), 3) << csv;  // 0, 1, 4
  m.signals = kPosition;
  for (m.k = 6; m.k < 9; ++m.k) take(to_wire(m, 7));
  EXPECT_EQ(status(get("/api/csv?trace=1&from=6&to=9")), 400);
}

TEST_F(ScopeServer, ADriveLogHasTheDeclaredLoadOfADriveThatWasHeardFromItsBegin) {
  recording_->use_config(
      Config::parse("preset = \"dilys2021\"\n[load]\nT_load_Nm = 0.25\nslew_Nm_s = 0\n", "drive")
          .merged(),
      "drive");
  Measurement m;
  m.signals = kPhaseCurrents;
  Truth t;
  t.T_load = 9;  // with the effects of the plant
  event_t steered{};
  steered.seq = 2;
  steered.session = 7;
  steered.reason = static_cast<int>(Reason::kSteered);
  steered.text = "load_Nm=0.5";
  for (m.k = t.k = 0; m.k < 4; ++m.k, ++t.k) {
    if (m.k == 2) take(steered);
    take(to_wire(m, 7));
    take(to_wire(t, 7));
  }
  const std::string rows = get("/api/csv?trace=1&from=0&to=4");
  EXPECT_NE(rows.find("T_load\n0,0,0,0,0.25\n0.0002,0,0,0,0.25\n0.0004,0,0,0,0.5\n"),
            std::string::npos)
      << rows;
  recording_->restart();
  recording_->use_config(Config::load("dilys2021").merged(), "dilys2021");
  for (m.k = 1; m.k < 4; ++m.k) take(to_wire(m, 8));
  EXPECT_EQ(get("/api/csv?trace=1&from=1&to=4").find("T_load"), std::string::npos);
}

class ScopeTraces : public ScopeServer {
 protected:
  ScopeTraces() {
    std::filesystem::remove_all(directory_);
    std::filesystem::create_directories(directory_);
    std::ofstream(program_) << "#!/bin/sh\n"
                               "test -n \"$(grep n_p $2)\" -a -s $4 || exit 7\n"
                               "mkdir $6 && echo 'the <b>result</b>' > $6/report.html\n"
                               "while test -e "
                            << directory_ << "/wait; do sleep 0.01; done\n";
    std::filesystem::permissions(program_, std::filesystem::perms::owner_all);
    recording_->use_config(Config::load("dilys2021").merged(), "dilys2021");
    Measurement m;
    m.signals = kPhaseCurrents;
    for (m.k = 0; m.k < 6; ++m.k) take(to_wire(m, 7));
  }
  std::string page_after_its_end(int id) {
    for (int i = 0; i < 500 && traces_.state(id)->running; ++i)
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    return get(fmt::format("/trace?id={}", id));
  }
  std::string directory_ = fmt::format("{}scope_traces-{}", ::testing::TempDir(), ::getpid());
  std::string program_ = directory_ + "/trace";
  Traces traces_{program_, directory_};
  Api api_{sources_, nullptr, "test", traces_};
  void SetUp() override { server_ = std::make_unique<Server>(api_, "127.0.0.1", 0); }
};

TEST_F(ScopeTraces, ShowsTheResultOfOneTraceAfterTheOther) {
  std::ofstream(directory_ + "/wait") << "";
  const std::string range = "{\"from\":0,\"to\":6}";
  EXPECT_NE(post("/api/trace", range).find("{\"trace\":1,"), std::string::npos);
  EXPECT_NE(get("/trace?id=1").find("Tracing dilys2021, 0 to 0.0012 s"), std::string::npos);
  EXPECT_EQ(status(post("/api/trace", range)), 400);  // one at a time
  std::filesystem::remove(directory_ + "/wait");
  const std::string page = page_after_its_end(1);
  EXPECT_NE(page.find("the <b>result</b>"), std::string::npos) << page;
  // Its scripts run apart from this server.
  const auto policy = page.find("Content-Security-Policy: sandbox allow-scripts");
  EXPECT_NE(policy, std::string::npos) << page;
  EXPECT_EQ(page.find("Content-Security-Policy", policy + 1), std::string::npos);
  EXPECT_NE(post("/api/trace", range).find("trace-2"), std::string::npos);
  EXPECT_EQ(status(get("/trace?id=3")), 400);
}

TEST_F(ScopeTraces, SaysWhyThereIsNoResult) {
  std::ofstream(program_) << "#!/bin/sh\necho 'too few <rows>' >&2\nexit 3\n";
  EXPECT_EQ(status(post("/api/trace", "{\"from\":0,\"to\":6}")), 200);
  const std::string page = page_after_its_end(1);
  EXPECT_NE(page.find("exit code 3"), std::string::npos) << page;
  EXPECT_NE(page.find("too few &lt;rows&gt;"), std::string::npos) << page;
}

TEST_F(ScopeServer, RefusesAPortThatIsTaken) {
  EXPECT_THROW(Server(api_, "127.0.0.1", server_->port()), BadInput);
}

}  // namespace
}  // namespace twinrate::scope
