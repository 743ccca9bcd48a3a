// A complete scope: a live drive or a log, its history, and the server of its page.
//
//   Scope scope({.port = 8080});   from then on the page at scope.url() shows the bus
#pragma once
#include <atomic>
#include <memory>
#include <string>
#include <thread>

#include "scope/api.hpp"
#include "scope/server.hpp"

namespace twinrate::scope {

struct ScopeOptions {
  std::string log;                      // a run directory or log; "": the bus
  std::string address = "127.0.0.1";    // any other address requires the token
  int port = 8080;                      // 0: any free one
  std::string url, channel_suffix;      // of the bus
  std::string drive_file;               // for a drive whose DRIVE_MANIFEST was missed
  LiveDrive::TokenOf token_of;          // LiveDrive::TokenOf; empty: requests are not tagged
  std::string runs_directory = "runs";  // directory of the ghosts and of the traces
  std::string program;                  // twinrate, for the traces of the page; "": no traces
  double history_s = 60;
  std::size_t memory_mib = 512;  // of the history, and of each ghost
};

class Scope {
 public:
  // Throws BadInput and MachineError. While a log is read, the page is already available.
  explicit Scope(const ScopeOptions& options);
  ~Scope();
  Scope(const Scope&) = delete;
  Scope& operator=(const Scope&) = delete;

  std::string page() const { return server_->url(); }
  int port() const { return server_->port(); }
  Recording& recording() { return *recording_; }
  LiveDrive* live() { return live_.get(); }
  std::int64_t refused() const { return server_->refused(); }
  // Of a log: 1 once it is read; then its damage, or the reason why it cannot be read.
  double share_read() const { return share_read_; }
  std::string damage() const;

 private:
  std::shared_ptr<Recording> recording_;
  std::unique_ptr<LiveDrive> live_;
  std::unique_ptr<Sources> sources_;
  std::unique_ptr<Traces> traces_;
  std::unique_ptr<Api> api_;
  std::unique_ptr<Server> server_;
  std::atomic<double> share_read_ = 0;
  mutable std::mutex mutex_;  // of damage_
  std::string damage_;
  std::thread reader_;
};

}  // namespace twinrate::scope
