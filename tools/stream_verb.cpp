// twinrate stream plotjuggler|foxglove: the messages of a running drive for other viewers.
#include <fmt/format.h>

#include <charconv>
#include <chrono>

#include "core/bus.hpp"
#include "core/config.hpp"
#include "core/output_file.hpp"
#include "core/process.hpp"
#include "run/progress.hpp"
#include "stream/foxglove.hpp"
#include "stream/plotjuggler.hpp"
#include "tools/verb.hpp"

namespace twinrate {
namespace {

constexpr double kDrain_ms = 2;

struct StreamOptions {
  std::string url, channel_suffix, duration, host = "127.0.0.1", layout, listen = "127.0.0.1";
  int udp_port = 9870, port = 8765;
};

double duration_of(const std::string& option) {
  if (option.empty()) return 0;
  const std::string text = seconds_text(option);
  double seconds = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), seconds);
  if (error != std::errc() || end != text.data() + text.size() || !(seconds > 0))
    throw BadInput(
        fmt::format("--duration {}: a time above 0 such as 5s or 500ms allowed", option));
  return seconds;
}

// Prints `ready` once it listens. Passes every message of the bus to `take`, and calls `between` in
// between. Sends nothing: the drive does not wait for this process. Returns the number of messages
// that did not arrive here.
template <class Take, class Between>
std::int64_t listen(const StreamOptions& o, const std::string& ready, Take take, Between between) {
  using Clock = std::chrono::steady_clock;
  const double duration_s = duration_of(o.duration);
  catch_stop_signals();
  Bus bus({.url = resolve_url(o.url),
           .channel_suffix = o.channel_suffix,
           .follow = true,
           .role = Role::kMonitor,
           .drain_every_ms = kDrain_ms});
  Sample sample;
  Layout layout;
  bus.subscribe_all([&](Channel channel, const std::uint8_t* bytes, std::size_t size, std::int64_t,
                        std::int64_t) {
    if (channel != Channel::kAck && read_sample(channel, bytes, size, sample, &layout))
      take(channel, layout, sample);
  });
  fmt::print("stream: {}\n", ready);
  std::fflush(stdout);
  const auto begin = Clock::now();
  while (!stop_signalled()) {
    bus.handle(5);
    between();
    if (duration_s > 0 && std::chrono::duration<double>(Clock::now() - begin).count() > duration_s)
      break;
  }
  return bus.counters().gaps;
}

void print_gaps(std::int64_t gaps) {
  if (gaps > 0) fmt::print("  {} messages of the drive did not arrive here\n", gaps);
}

void stream_plotjuggler(const StreamOptions& o) {
  if (!o.layout.empty()) {
    write_new(o.layout, plotjuggler_layout());
    fmt::print("{}: a layout; in PlotJuggler: Layout, Load Layout\n", o.layout);
    return;
  }
  PlotjugglerSender sender(o.host, o.udp_port);
  const std::int64_t gaps = listen(
      o,
      fmt::format("UDP to {}:{}; in PlotJuggler: Streaming, UDP Server, json, use timestamp",
                  o.host, o.udp_port),
      [&](Channel channel, const Layout& l, const Sample& s) { sender.send(channel, l, s); },
      [] {});
  fmt::print("stream: {} datagrams sent, {} lost, {} refused: nobody listened\n", sender.sent(),
             sender.lost(), sender.unheard());
  print_gaps(gaps);
}

void stream_foxglove(const StreamOptions& o) {
  FoxgloveServer server(o.listen, o.port);
  const std::int64_t gaps = listen(
      o,
      fmt::format("ws://{}:{}; in Foxglove: Open connection, Foxglove WebSocket", o.listen,
                  server.port()),
      [&](Channel channel, const Layout& l, const Sample& s) { server.offer(channel, l, s); },
      [&] { server.serve(); });
  fmt::print("stream: {} messages sent, {} lost to slow clients\n", server.sent(), server.lost());
  print_gaps(gaps);
}

}  // namespace

void add_stream_verb(CLI::App& app, int&) {
  auto o = std::make_shared<StreamOptions>();
  CLI::App* verb = app.add_subcommand("stream", "Show a running drive in PlotJuggler or Foxglove");
  verb->require_subcommand(1);
  const auto common = [&](CLI::App* kind) {
    kind->add_option("--duration", o->duration, "stop after this time, e.g. 5s (default: Ctrl-C)");
    kind->add_option("--lcm-url", o->url, "listen to this LCM bus");
    kind->add_option("--channel-suffix", o->channel_suffix, "listen to the drive with this suffix");
  };
  CLI::App* udp = verb->add_subcommand("plotjuggler", "Send every message as JSON over UDP");
  udp->add_option("--host", o->host, "send to this IPv4 address");
  udp->add_option("--port", o->udp_port, "send to this port")->check(CLI::Range(1, 65535));
  udp->add_option("--layout", o->layout, "write a layout file for PlotJuggler, and stop");
  common(udp);
  udp->callback([o] { stream_plotjuggler(*o); });
  CLI::App* ws = verb->add_subcommand("foxglove", "Serve every message over a websocket");
  ws->add_option("--listen", o->listen, "listen at this address");
  ws->add_option("--port", o->port, "listen at this port; 0: a free one")
      ->check(CLI::Range(0, 65535));
  common(ws);
  ws->callback([o] { stream_foxglove(*o); });
}

}  // namespace twinrate
