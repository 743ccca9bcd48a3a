#include "scope/scope.hpp"

#include <fmt/format.h>

#include <filesystem>

#include "core/bus_parameters.hpp"
#include "core/config.hpp"
#include "core/event_log.hpp"
#include "scope/recorded_drive.hpp"

namespace twinrate::scope {
namespace {

// A lock-step set does not wait for the page. The buffer holds about 1 s of an unpaced set: 10 000
// ticks of five messages, each about 1 KiB in the count of the kernel.
constexpr int kReceiveBuffer = 32 << 20;
// No process waits for the page. If each message woke it, it would take the processor from the
// drive. A frame of the page is sent every 50 ms.
constexpr double kDrain_ms = 5;

std::string with_receive_buffer(const std::string& url) {
  if (!url.starts_with("udpm://") || url.find("recv_buf_size") != std::string::npos) return url;
  return fmt::format("{}{}recv_buf_size={}", url, url.find('?') == std::string::npos ? '?' : '&',
                     kReceiveBuffer);
}

}  // namespace

Scope::Scope(const ScopeOptions& options)
    : recording_(std::make_shared<Recording>(options.log.empty() ? options.history_s : 1e9,
                                             options.memory_mib << 20)) {
  BusOptions bus{.url = with_receive_buffer(resolve_url(options.url)),
                 .channel_suffix = options.channel_suffix,
                 .drain_every_ms = kDrain_ms};
  if (!options.drive_file.empty()) {
    Config config = Config::load(options.drive_file);
    recording_->use_config(config.merged(), options.drive_file);
    recording_->use_run_directory(std::filesystem::path(options.drive_file).parent_path());
    bus.split_ports = config.read<BusParameters>().split_ports;
  }
  if (options.log.empty())
    live_ = std::make_unique<LiveDrive>(bus, *recording_, options.token_of);
  else
    log_parts(options.log);  // refuses a path that is no log
  sources_ =
      std::make_unique<Sources>(recording_, options.runs_directory, options.memory_mib << 20);
  traces_ = std::make_unique<Traces>(options.program, options.runs_directory);
  api_ = std::make_unique<Api>(*sources_, live_.get(), options.log.empty() ? "live" : options.log,
                               *traces_);
  server_ = std::make_unique<Server>(*api_, options.address, options.port);
  if (live_) return;
  reader_ = std::thread([this, log = options.log] {
    std::string damage;
    try {
      damage = load_log(log, *recording_, &share_read_);
    } catch (const std::exception& error) {
      damage = error.what();
    }
    const std::lock_guard lock(mutex_);
    damage_ = damage;
    share_read_ = 1;
  });
}

Scope::~Scope() {
  server_.reset();
  if (reader_.joinable()) reader_.join();
}

std::string Scope::damage() const {
  const std::lock_guard lock(mutex_);
  return damage_;
}

}  // namespace twinrate::scope
