#include "run/own_monitor.hpp"

#include <optional>
#include <stdexcept>
#include <utility>

#include "core/output_file.hpp"
#include "monitor/live_monitor.hpp"

namespace twinrate {
namespace {

class OwnMonitor : public TickWatch {
 public:
  OwnMonitor(Config& config, ClosedLoop& loop, std::string directory, PublishEvent publish)
      : config_(config),
        loop_(loop),
        directory_(std::move(directory)),
        publish_(std::move(publish)),
        monitor_(config) {}

  bool write() const override {
    try {
      write_new(directory_ + "/monitor.json", monitor_.to_json());
    } catch (const std::runtime_error&) {
      return false;
    }
    return true;
  }

  void take(const TickRecord& tick) override {
    monitor_.take(tick.measurement);
    monitor_.take(tick.estimate);
    while (const auto job = monitor_.take_job()) monitor_.traced(run(*job));
    if (const auto toml = monitor_.take_addition())
      come(present().with_effects(*toml, "monitor"), true);
    if (const auto toml = monitor_.take_removal())
      come(present().without_effects(*toml, "monitor", config_.drive().effects.size()), false);
    for (const MonitorNotice& notice : monitor_.take_notices())
      publish_(notice.reason, notice.text, notice.k, tick.measurement.t_ns);
    if (coming_ && loop_.k() >= from_k_) {
      loop_.know(*coming_);
      extended_ = std::exchange(coming_, {});
      if (adding_)
        monitor_.added(loop_.k());
      else
        monitor_.removed(loop_.k());
    }
  }

 private:
  const Config& present() const { return extended_ ? *extended_ : config_; }
  void come(Config changed, bool adding) {
    coming_ = std::move(changed);
    adding_ = adding;
    from_k_ = monitor_.tick_for_request();
  }

  Config& config_;
  ClosedLoop& loop_;
  std::string directory_;
  PublishEvent publish_;
  LiveMonitor monitor_;
  std::optional<Config> extended_, coming_;
  bool adding_ = true;
  std::int64_t from_k_ = 0;
};

}  // namespace

std::unique_ptr<TickWatch> make_own_monitor(Config& config, ClosedLoop& loop,
                                            const std::string& directory,
                                            const PublishEvent& publish) {
  return std::make_unique<OwnMonitor>(config, loop, directory, publish);
}

}  // namespace twinrate
