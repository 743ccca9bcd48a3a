// A live drive: one thread on the bus that fills a Recording and sends requests.
//
//   every channel -> [LiveDrive] -> Recording
//   Steering (any thread) -> DRIVE_REQUEST, DRIVE_REPLY -> the caller
//
// A reader of the Recording blocks the thread at most for the reduction of one signal. Messages
// that arrive meanwhile wait in LCM's queue and in the socket; messages lost there are counted as
// gaps. The drive follows one session: the first one heard, and another one after kSessionSilent_s
// of silence.
#pragma once
#include <atomic>
#include <condition_variable>
#include <deque>
#include <functional>
#include <memory>
#include <thread>

#include "core/arbiter.hpp"
#include "core/bus.hpp"
#include "scope/recording.hpp"
#include "scope/steering.hpp"

namespace twinrate::scope {

inline constexpr double kSessionSilent_s = 1.0;

class LiveDrive : public Steering {
 public:
  // The token file of a session, with which requests are tagged; "" if none is known.
  using TokenOf = std::function<std::string(std::int64_t session)>;

  // Throws the MachineError and BadInput of Bus. `options.session` 0: the first session heard.
  LiveDrive(const BusOptions& options, Recording& recording, TokenOf token_of = {});
  ~LiveDrive() override;
  LiveDrive(const LiveDrive&) = delete;
  LiveDrive& operator=(const LiveDrive&) = delete;

  double silent_s() const;  // since the last message of the session, or since the start
  bool heard() const { return heard_; }
  std::int64_t session() const { return session_; }
  const std::string& url() const { return url_; }
  // Holder of the control of the drive, as far as its messages were received; "": nobody. name():
  // this scope.
  std::string holder() const;
  const std::string& name() const { return name_; }

  Replies steer(const std::string& lines) override;
  Replies take_control() override;
  Replies give_control() override;
  void beat() override;
  Replies start() override;
  Replies stop() override;
  Replies emergency_stop() override;
  Replies reset() override;
  Replies add_proposed() override;
  Replies add_effects(const std::string& toml) override;
  Replies remove_effects(const std::string& toml) override;

 private:
  struct Asked {
    request_t request;
    std::size_t wanted = 1;  // number of answers
    Replies replies;
    double asked_s = 0, sent_s = 0;
    bool done = false;
  };

  void run(const std::stop_token& stop);
  void open_bus();
  void look_for_token();
  void hear(Channel channel, const std::uint8_t* bytes, std::size_t size);
  void answer(const reply_t& reply);
  void note_holder(const std::uint8_t* bytes, std::size_t size);
  std::string holder_line() const { return Arbiter::kHolderLine + name_ + "\n"; }
  void send_requests();
  void send_beat();
  Replies ask(RequestKind kind, std::size_t wanted, const std::string& text = "", double value = 0);

  Recording& recording_;
  BusOptions options_;
  TokenOf token_of_;
  const std::string name_;          // name as holder of the control, different for each scope
  std::int64_t token_session_ = 0;  // the session of the last search for a token
  std::string url_;
  std::unique_ptr<Bus> bus_;
  std::atomic<std::int64_t> session_ = 0, last_heard_us_;
  std::atomic<bool> heard_ = false;
  std::atomic<double> beat_asked_s_ = -1;  // time of the last beat()
  double beat_sent_s_ = -1;
  mutable std::mutex mutex_;  // of asked_ and holder_
  std::string holder_;
  std::atomic<std::int64_t> beaten_ = 0;  // number of the last heartbeat
  std::condition_variable answered_;
  std::deque<std::shared_ptr<Asked>> asked_;
  std::jthread thread_;  // last: it uses the others
};

}  // namespace twinrate::scope
