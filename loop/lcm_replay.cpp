#include "loop/lcm_replay.hpp"

#include <chrono>
#include <filesystem>
#include <fstream>

#include "core/process.hpp"
#include "core/seconds_since.hpp"
#include "core/signals_io.hpp"

namespace twinrate {
namespace {

using Clock = std::chrono::steady_clock;

std::vector<std::uint8_t> bytes_of(const Estimate& e) {
  const estimate_t wire = to_wire(e, 0);
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(wire.getEncodedSize()));
  wire.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}

}  // namespace

bool same_bits(const Estimate& a, const Estimate& b) {
  return bytes_of(a) == bytes_of(b);
}

OwnEstimator::OwnEstimator(const std::string& config_toml, const BusAddress& address,
                           std::int64_t session) {
  char name[] = "/tmp/twinrate-replay-XXXXXX";
  if (!mkdtemp(name)) throw std::runtime_error("no temporary directory can be made");
  directory_ = name;
  std::ofstream(directory_ + "/config.toml") << config_toml;
  std::vector<std::string> list = {"--config", directory_ + "/config.toml", "--session",
                                   std::to_string(session), "--follow"};
  if (!address.url.empty()) list.insert(list.end(), {"--lcm-url", address.url});
  if (!address.channel_suffix.empty())
    list.insert(list.end(), {"--channel-suffix", address.channel_suffix});
  set_.start(Role::kGain, "twinrate-gain", list);
  set_.start(Role::kEstimator, "twinrate-estimator", list);
}

OwnEstimator::~OwnEstimator() {
  set_.stop({Role::kEstimator, Role::kGain}, 3);
  std::error_code ignored;
  std::filesystem::remove_all(directory_, ignored);
}

LcmReplay::LcmReplay(const BusParameters& parameters, const BusAddress& address,
                     std::int64_t session)
    : parameters_(parameters),
      session_(session),
      bus_({.url = address.url,
            .channel_suffix = address.channel_suffix,
            .session = session,
            .role = Role::kReplay}) {
  bus_.subscribe<estimate_t>([this](const estimate_t& w) {
    if (w.seq == waiting_k_) answer_ = from_wire(w);
  });
}

std::optional<Estimate> LcmReplay::play(const Measurement& m) {
  answer_.reset();
  waiting_k_ = m.k;
  const auto begun = Clock::now();
  auto sent = begun;
  bus_.publish(to_wire(m, session_));
  while (!answer_ && !stop_signalled()) {
    bus_.handle(parameters_.repeat_after_ms);
    if (answer_ || seconds_since(begun) > parameters_.peer_timeout_s) break;
    if (seconds_since(sent) * 1000 < parameters_.repeat_after_ms) continue;
    ++repeats_;
    sent = Clock::now();
    bus_.publish(to_wire(m, session_));
  }
  return answer_;
}

}  // namespace twinrate
