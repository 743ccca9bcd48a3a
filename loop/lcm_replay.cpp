#include "loop/lcm_replay.hpp"

#include <fmt/format.h>

#include <chrono>
#include <filesystem>
#include <fstream>

#include "core/process.hpp"
#include "core/reason.hpp"
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

// From the events of the estimator, in the words of Process.
std::vector<ModelChange> model_changes_in(const RunLog& log) {
  std::vector<ModelChange> changes;
  for (const EventRecord& event : log.events) {
    const bool add = event.reason == static_cast<int>(Reason::kEffectAdded);
    if (!add && event.reason != static_cast<int>(Reason::kEffectRemoved)) continue;
    const std::string before = add ? "on with " : "on without ";
    const auto at = event.text.find(before);
    if (event.role == static_cast<int>(Role::kEstimator) && at != std::string::npos)
      changes.push_back({event.k, add, event.text.substr(at + before.size())});
  }
  return changes;
}

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
  bus_.subscribe<reply_t>([this](const reply_t& reply) {
    if (reply.seq != asked_) return;
    if (reply.accepted == 0) refused_ = reply.text;
    agreed_.insert(reply.role);
  });
}

// A process that starts may miss a request: it is repeated.
void LcmReplay::change_model(const ModelChange& change) {
  constexpr double kStart_s = 10;
  request_t request{};
  request.seq = asked_ = new_session_id();
  request.session = session_;
  request.kind =
      static_cast<std::int32_t>(change.add ? RequestKind::kAddEffect : RequestKind::kRemoveEffect);
  request.value = static_cast<double>(change.k);
  request.text = change.effects;
  agreed_.clear();
  const auto begun = Clock::now();
  while (agreed_.size() < 2 && refused_.empty() && !stop_signalled()) {
    bus_.publish(request);
    const auto sent = Clock::now();
    while (agreed_.size() < 2 && seconds_since(sent) * 1000 < parameters_.repeat_after_ms)
      bus_.handle(parameters_.repeat_after_ms);
    if (seconds_since(begun) > kStart_s) refused_ = "estimator and gain did not both answer";
  }
  if (!refused_.empty())
    throw BadInput(fmt::format("the effects of tick {}: {}", change.k, refused_));
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
