// The part `http` (core/load_part.hpp): the one file that includes httplib.h.

#include <fmt/format.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <chrono>
#include <random>
#include <set>
#include <thread>

#include "core/config.hpp"
#include "core/load_part.hpp"
#include "scope/assets.hpp"
#include "scope/server.hpp"

// Included last: it defines macros of <resolv.h> that break Eigen.
#include <httplib.h>

namespace twinrate::scope {
namespace {

using Clock = std::chrono::steady_clock;

// A token of 128 bits.
std::string new_token() {
  std::random_device device;
  std::string token;
  for (int i = 0; i < 4; ++i) token += fmt::format("{:08x}", device());
  return token;
}

// Takes the same time for every wrong token of the right length.
bool same_text(const std::string& a, const std::string& b) {
  unsigned difference = a.size() == b.size() ? 0 : 1;
  for (std::size_t i = 0; i < std::min(a.size(), b.size()); ++i)
    difference |= static_cast<unsigned char>(a[i]) ^ static_cast<unsigned char>(b[i]);
  return difference == 0;
}

std::string type_of(std::string_view name) {
  if (name.ends_with(".html")) return "text/html; charset=utf-8";
  if (name.ends_with(".css")) return "text/css; charset=utf-8";
  return "text/javascript; charset=utf-8";
}

// One request on a socket, which must arrive completely before the deadline.
class SocketStream : public httplib::Stream {
 public:
  SocketStream(socket_t socket, double request_s)
      : socket_(socket),
        deadline_(Clock::now() + std::chrono::milliseconds(static_cast<int>(1000 * request_s))) {}

  bool is_readable() const override {
    return left_ms() > 0 && taken_ < kMostRequestBytes && wait(POLLIN, left_ms());
  }
  bool is_writable() const override { return wait(POLLOUT, 5000) && !peer_left(); }
  ssize_t read(char* to, std::size_t size) override {
    if (!is_readable()) return -1;
    const ssize_t count = ::recv(socket_, to, size, 0);
    taken_ += static_cast<std::size_t>(std::max<ssize_t>(0, count));
    return count;
  }
  ssize_t write(const char* from, std::size_t size) override {
    return wait(POLLOUT, 5000) ? ::send(socket_, from, size, MSG_NOSIGNAL) : -1;
  }
  void get_remote_ip_and_port(std::string& ip, int& port) const override { ip = "", port = 0; }
  void get_local_ip_and_port(std::string& ip, int& port) const override { ip = "", port = 0; }
  socket_t socket() const override { return socket_; }

 private:
  int left_ms() const {
    const auto left = deadline_ - Clock::now();
    return std::max(
        0, static_cast<int>(std::chrono::duration_cast<std::chrono::milliseconds>(left).count()));
  }
  bool wait(short events, int timeout_ms) const {
    pollfd descriptor{.fd = socket_, .events = events, .revents = 0};
    return ::poll(&descriptor, 1, timeout_ms) > 0 && (descriptor.revents & events) != 0;
  }
  bool peer_left() const {
    char byte = 0;
    return ::recv(socket_, &byte, 1, MSG_PEEK | MSG_DONTWAIT) == 0;
  }

  // Limit of the body, and the same again for the headers before it.
  static constexpr std::size_t kMostRequestBytes = 2 * kMostBodyBytes;
  socket_t socket_;
  std::size_t taken_ = 0;
  Clock::time_point deadline_;
};

// One request a connection. The accepting thread closes a connection for which no thread is free.
class OneRequestServer : public httplib::Server {
 public:
  std::atomic<std::int64_t> refused = 0;
  double request_s = kRequest_s;
  static thread_local bool no_place;
  // With the library's backlog of 5, connections would wait instead of being refused.
  void lengthen_backlog() { ::listen(svr_sock_, 128); }

 private:
  bool process_and_close_socket(socket_t socket) override {
    bool done = false;
    if (no_place) {
      ++refused;
    } else {
      SocketStream stream(socket, request_s);
      bool closed = false;
      done = process_request(stream, true, closed, nullptr);
    }
    ::shutdown(socket, SHUT_RDWR);
    ::close(socket);
    return done;
  }
};
thread_local bool OneRequestServer::no_place = false;

class LimitedPool : public httplib::ThreadPool {
 public:
  LimitedPool() : ThreadPool(kMostConnections) {}
  void enqueue(std::function<void()> request) override {
    if (open_ >= kMostConnections) {
      OneRequestServer::no_place = true;
      request();
      OneRequestServer::no_place = false;
      return;
    }
    ++open_;
    ThreadPool::enqueue([this, request = std::move(request)] {
      request();
      --open_;
    });
  }

 private:
  std::atomic<std::size_t> open_ = 0;
};

Query query_of(const httplib::Request& request) {
  Query query{.path = request.path, .parameters = {}, .body = request.body};
  query.post = request.method == "POST";
  for (const auto& [key, value] : request.params) query.parameters[key] = value;
  return query;
}

struct HttpServer final : Server::Http {
  Api& api;
  Server::FindAsset find_asset;
  std::string address, token;
  int port = 0;
  OneRequestServer http;
  std::set<std::string> hosts;
  std::atomic<bool> stopping = false;
  std::thread thread;

  HttpServer(Api& served, const Server::Settings& settings);
  ~HttpServer() override;
  std::string url() const override;
  int bound_port() const override { return port; }
  std::int64_t refused() const override { return http.refused; }

 private:
  void allow_hosts();
  std::string refusal(const httplib::Request& request) const;
  void add_pages();
  void set_up();
  void add_stream();
};

// Refuses other host names, so that another site cannot use a name of its own for this address (DNS
// rebinding).
void HttpServer::allow_hosts() {
  for (const std::string name : {"127.0.0.1", "localhost", "[::1]"})
    hosts.insert(fmt::format("{}:{}", name, port));
  if (address != "0.0.0.0" && address != "127.0.0.1")
    hosts.insert(fmt::format("{}:{}", address, port));
}

// "" if the request is allowed.
std::string HttpServer::refusal(const httplib::Request& request) const {
  const std::string host = request.get_header_value("Host");
  // A server on every address of the machine allows any host name: the token protects it.
  if (address != "0.0.0.0" && !hosts.count(host)) return "Host: not an address of this server\n";
  if (request.has_header("Origin") && request.get_header_value("Origin") != "http://" + host)
    return "Origin: only pages of this server may ask\n";
  if (request.get_header_value("Sec-Fetch-Site") == "cross-site")
    return "only pages of this server may ask\n";
  const bool of_the_program = request.path.ends_with(".js") || request.path.ends_with(".css");
  if (!token.empty() && !same_text(request.get_param_value("token"), token) &&
      !(of_the_program && !request.path.starts_with("/api/")))
    return "token: open the address that twinrate scope printed\n";
  return "";
}

void HttpServer::add_pages() {
  http.Get("/", [this](const httplib::Request&, httplib::Response& response) {
    const Asset* page = find_asset("scope.html");
    response.set_content(page->bytes.data(), page->bytes.size(), "text/html; charset=utf-8");
  });
  http.Get(R"(/([A-Za-z_.]+\.(js|css)))",
           [this](const httplib::Request& request, httplib::Response& response) {
             const Asset* asset = find_asset(request.matches[1].str());
             if (!asset) {
               response.status = 404;
               return;
             }
             response.set_content(asset->bytes.data(), asset->bytes.size(), type_of(asset->name));
           });
  const auto answer = [this](const httplib::Request& request, httplib::Response& response) {
    const Answer a = api.answer(query_of(request));
    response.status = a.status;
    if (!a.file_name.empty())
      response.set_header("Content-Disposition",
                          fmt::format("attachment; filename=\"{}\"", a.file_name));
    response.set_content(a.body, a.type);
  };
  http.Get(R"(/api/[a-z]+)", answer);
  // A page of `twinrate trace` contains its scripts and gets a policy of its own: inline scripts
  // are allowed, requests to this server are not.
  http.Get("/trace", [answer](const httplib::Request& request, httplib::Response& response) {
    answer(request, response);
    response.headers.erase("Content-Security-Policy");
    response.set_header("Content-Security-Policy",
                        "sandbox allow-scripts allow-downloads allow-popups; default-src 'none'; "
                        "script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
                        "img-src blob: data:; font-src data:");
  });
  http.Post(R"(/api/[a-z]+)", answer);
}

// A frame contains all changes since the last frame: a slow page gets fewer and larger frames, and
// no queue grows.
void HttpServer::add_stream() {
  http.Get("/api/stream", [this](const httplib::Request& request, httplib::Response& response) {
    auto stream = std::make_shared<Api::Stream>(api.open_stream(query_of(request)));
    response.set_header("Cache-Control", "no-store");
    static constexpr auto kPeriod =
        std::chrono::milliseconds(static_cast<int>(1000 / kFramesPerSecond));
    response.set_content_provider(
        "text/event-stream",
        [this, stream, due = Clock::now()](std::size_t, httplib::DataSink& sink) mutable {
          due = std::max(due + kPeriod, Clock::now());
          const std::string text = "data: " + api.frame(*stream) + "\n\n";
          if (stopping || !sink.is_writable() || !sink.write(text.data(), text.size()))
            return false;
          std::this_thread::sleep_until(due);
          return !stopping.load();
        });
  });
}

// Limits, headers, refused requests and errors.
void HttpServer::set_up() {
  http.new_task_queue = [] { return new LimitedPool; };
  // SO_REUSEADDR instead of SO_REUSEPORT, the library's default: a port has one server.
  http.set_socket_options([](socket_t socket) {
    const int yes = 1;
    ::setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
  });
  http.set_payload_max_length(kMostBodyBytes);
  http.set_default_headers({{"X-Content-Type-Options", "nosniff"},
                            {"X-Frame-Options", "DENY"},
                            {"Referrer-Policy", "no-referrer"},
                            {"Content-Security-Policy",
                             "default-src 'self'; img-src 'self' blob: data:; "
                             "style-src 'self' 'unsafe-inline'"}});
  http.set_pre_routing_handler(
      [this](const httplib::Request& request, httplib::Response& response) {
        const std::string why = refusal(request);
        if (why.empty()) return httplib::Server::HandlerResponse::Unhandled;
        response.status = 403;
        response.set_content(why, "text/plain");
        return httplib::Server::HandlerResponse::Handled;
      });
  http.set_exception_handler(
      [](const httplib::Request&, httplib::Response& response, const std::exception_ptr& thrown) {
        response.status = 500;
        try {
          std::rethrow_exception(thrown);
        } catch (const BadInput& error) {
          response.status = 400;
          response.set_content(std::string(error.what()) + "\n", "text/plain");
        } catch (const std::exception& error) {
          response.set_content(std::string(error.what()) + "\n", "text/plain");
        }
      });
}

HttpServer::HttpServer(Api& served, const Server::Settings& settings)
    : api(served), find_asset(settings.find_asset), address(settings.address) {
  http.request_s = settings.request_s;
  if (address != "127.0.0.1" && address != "localhost") token = new_token();
  set_up();
  add_stream();
  add_pages();
  port = settings.port == 0 ? http.bind_to_any_port(address) : settings.port;
  if (port < 0 || (settings.port != 0 && !http.bind_to_port(address, port)))
    throw BadInput(fmt::format(
        "--listen {} --port {}: cannot listen there: an address of this machine and a free port "
        "allowed",
        address, settings.port));
  http.lengthen_backlog();
  allow_hosts();
  thread = std::thread([this] { http.listen_after_bind(); });
  // A stop() before the server runs would have no effect.
  while (!http.is_running()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
}

HttpServer::~HttpServer() {
  stopping = true;
  http.stop();
  if (thread.joinable()) thread.join();
}

std::string HttpServer::url() const {
  const std::string name = address == "0.0.0.0" ? "127.0.0.1" : address;
  return fmt::format("http://{}:{}/{}", name, port, token.empty() ? "" : "?token=" + token);
}

}  // namespace
}  // namespace twinrate::scope

TWINRATE_PART twinrate::scope::Server::Http* twinrate_part(
    twinrate::scope::Api& api, const twinrate::scope::Server::Settings& settings) {
  return new twinrate::scope::HttpServer(api, settings);
}
