// Messages with the right session id that no process of the set sent, while a lock-step run is on:
// malformed, of ticks that cannot be yet or are long over, not finite, not plausible. The run ends
// and its log is that of the undisturbed run, bit for bit.
//
// With the tags of the set switched off, a message of the present tick, well formed and with
// plausible values, is not among them: nobody can know it from the genuine one. With the tags it is.
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <functional>
#include <lcm/lcm-cpp.hpp>
#include <limits>
#include <map>
#include <optional>
#include <thread>

#include "core/channels.hpp"
#include "core/decode.hpp"
#include "core/event_log.hpp"
#include "core/message_tag.hpp"
#include "core/reason.hpp"
#include "tests/system/log_messages.hpp"
#include "tests/system/run_program.hpp"

namespace twinrate::test {
namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr int kHostileTicks = 4000;
constexpr std::int64_t kPeriod_ns = 200'000;
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

template <class Message>
Bytes encoded(const Message& message) {
  Bytes bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}

void put_int32(Bytes& bytes, std::size_t at, std::int32_t value) {
  for (std::size_t i = 0; i < 4; ++i)
    bytes[at + i] = static_cast<std::uint8_t>(static_cast<std::uint32_t>(value) >> (24 - 8 * i));
}

// Sends to the set of one session, and hears at which tick it is.
class Attacker {
 public:
  static constexpr double kForged_V = 12.345;
  // With a token file every message has a valid tag.
  explicit Attacker(std::int64_t session, const std::string& token_file = "") : session_(session) {
    if (!token_file.empty()) tagger_.emplace(read_token(token_file));
    bus_.subscribe("DRIVE_COMMAND", &Attacker::hear, this);
  }
  std::int64_t k() {
    while (bus_.handleTimeout(0) > 0) {
    }
    return k_;
  }
  // A damaged copy of each kind of damage, on the message's own channel.
  template <class Message>
  void damage(Message message, const std::vector<std::size_t>& texts_at = {}) {
    message.session = session_;
    const Bytes whole = encoded(message);
    send<Message>(Bytes(whole.begin(), whole.begin() + static_cast<long>(whole.size() / 2)));
    send<Message>(Bytes(whole.begin(), whole.begin() + 32));
    Bytes longer = whole;
    longer.resize(whole.size() + 3000);
    send<Message>(longer);
    Bytes other_type = whole;
    other_type[3] ^= 0x40;
    send<Message>(other_type);
    for (const std::size_t at : texts_at)
      for (const std::int32_t length : {0, -1, INT32_MIN, INT32_MAX}) {
        Bytes text = whole;
        put_int32(text, at, length);
        send<Message>(text);
      }
  }
  template <class Message>
  void say(Message message, std::int64_t seq) {
    message.session = session_;
    message.seq = seq;
    message.t_ns = seq * kPeriod_ns;
    send<Message>(encoded(message));
  }
  int sent() const { return sent_; }
  bool has_token() const { return tagger_.has_value(); }

 private:
  template <class Message>
  void send(Bytes bytes) {
    if (tagger_) tagger_->put(info(kChannelOf<Message>).name, bytes.data(), bytes.size());
    bus_.publish(info(kChannelOf<Message>).name, bytes.data(), static_cast<unsigned>(bytes.size()));
    ++sent_;
  }
  void hear(const lcm::ReceiveBuffer* buffer, const std::string&) {
    command_t command;
    if (!decode(command, buffer->data, buffer->data_size)) return;
    const bool own = command.u_alpha_V == kForged_V || std::isnan(command.u_alpha_V);
    if (!own && command.session == session_) k_ = command.seq;
  }

  lcm::LCM bus_;
  std::optional<Tagger> tagger_;
  std::int64_t session_, k_ = -1;
  int sent_ = 0;
};

gain_t forged_gain(double K, double P) {
  gain_t gain{};
  gain.n_x = 4;
  gain.n_y = 2;
  gain.n_K = 8;
  gain.K.assign(8, K);
  gain.n_P = 16;
  gain.P.assign(16, P);
  return gain;
}

command_t forged_command(double u) {
  command_t command{};
  command.u_alpha_V = u;
  command.u_beta_V = u;
  return command;
}

estimate_t forged_estimate(double x) {
  estimate_t estimate{};
  estimate.n_x = 4;
  estimate.n_y = 2;
  estimate.x_hat.assign(4, x);
  estimate.innov.assign(2, x);
  return estimate;
}

measurement_t marked(std::int64_t ahead) {
  measurement_t measurement{};
  measurement.v_dc_V = static_cast<double>(ahead);  // tells in a failed comparison which one it was
  return measurement;
}

void send_malformed(Attacker& attacker) {
  status_t unknown_role{};
  unknown_role.role = 99;
  attacker.say(unknown_role, 1);
  unknown_role.role = -7;
  attacker.say(unknown_role, 1);
  attacker.damage(measurement_t{});
  attacker.damage(truth_t{});
  attacker.damage(forged_estimate(0));
  attacker.damage(forged_gain(0, 1));
  attacker.damage(reference_t{});
  attacker.damage(forged_command(Attacker::kForged_V));
  attacker.damage(status_t{});
  attacker.damage(ack_t{});
  attacker.damage(event_t{}, {44});
  attacker.damage(manifest_t{}, {36, 41, 46});
  attacker.damage(request_t{}, {44});
  attacker.damage(reply_t{}, {48});
}

// Of later ticks: the next but few, later ones of the run, and beyond its end.
void send_of_the_future(Attacker& attacker) {
  const std::int64_t k = attacker.k();
  for (const std::int64_t ahead :
       {std::int64_t{400}, std::int64_t{1000}, std::int64_t{100'000}, std::int64_t{1} << 50}) {
    const std::int64_t seq = (k + ahead) / 5 * 5;
    attacker.say(marked(ahead), seq);
    attacker.say(truth_t{}, seq);
    attacker.say(forged_estimate(1), seq);
    attacker.say(forged_gain(1, 1), seq);
    attacker.say(reference_t{}, seq);
    attacker.say(forged_command(Attacker::kForged_V), seq);
    attacker.say(forged_command(kNan), seq);
    attacker.say(ack_t{}, seq);
  }
}

void send_of_the_past(Attacker& attacker) {
  const std::int64_t seq = std::max<std::int64_t>(0, attacker.k() / 5 * 5 - 40);
  attacker.say(marked(-40), seq);
  attacker.say(forged_estimate(kNan), seq);
  for (int late = 0; late < 30; ++late) attacker.say(forged_gain(1, 1), seq);
  attacker.say(forged_gain(kNan, 1), seq + 35);
  attacker.say(forged_gain(1, -1), seq + 35);
  attacker.say(forged_gain(1, 1), seq + 1);  // no snapshot
  attacker.say(forged_command(kNan), seq);
  attacker.say(reference_t{}, seq);
  status_t other_drive{};
  other_drive.role = 1;
  other_drive.config_hash = 42;
  attacker.say(other_drive, seq);
}

// Messages that the processes counted as malformed and as refused, by role, from their last words.
std::map<int, std::pair<std::int64_t, std::int64_t>> counted(const std::string& run) {
  std::map<int, std::pair<std::int64_t, std::int64_t>> all;
  EventLog log(run, OnDamage::kRefuse);
  while (const lcm::LogEvent* event = log.next()) {
    status_t status;
    if (log.channel() != Channel::kStatus ||
        !decode(status, event->data, static_cast<std::size_t>(event->datalen)))
      continue;
    auto& [malformed, refused] = all[status.role];
    malformed = std::max(malformed, status.undecodable);
    refused = std::max(refused, status.refused);
  }
  return all;
}

// Of the tick that the drive is at, and of the next ones, as the genuine senders could send them.
void send_of_the_present(Attacker& attacker) {
  for (int i = 0; i < 50; ++i) {
    const std::int64_t k = attacker.k();
    for (std::int64_t ahead = 0; ahead < 3; ++ahead) {
      attacker.say(forged_command(Attacker::kForged_V), k + ahead);
      attacker.say(forged_estimate(1), k + ahead);
      attacker.say(reference_t{}, k + ahead);
      measurement_t measurement{};
      measurement.v_dc_V = 40;
      attacker.say(measurement, k + ahead);
      attacker.say(truth_t{}, k + ahead);
    }
    attacker.say(forged_gain(0.5, 1), k / 5 * 5);
    ack_t ack{};
    attacker.say(ack, k);
    if (!attacker.has_token()) {  // who has the token may stop the drive
      request_t stop{};
      stop.kind = static_cast<std::int32_t>(RequestKind::kEmergencyStop);
      attacker.say(stop, k);
    }
    status_t failed{};
    failed.role = static_cast<std::int32_t>(Role::kPlant);
    failed.state = static_cast<std::int32_t>(ProcessState::kFailed);
    attacker.say(failed, k);
    event_t event{};
    event.role = static_cast<std::int32_t>(Role::kPlant);
    event.reason = static_cast<std::int32_t>(Reason::kPlantFailed);
    event.waited_for = -1;
    attacker.say(event, k);
  }
}

class Hostile : public ProgramTest {
 protected:
  // Runs the set under `attack`, and compares its log with the undisturbed one.
  void run(const std::vector<std::string>& more, const std::function<void(Attacker&)>& attack,
           bool with_token = false) {
    const auto arguments = [&](const std::string& verb) {
      return std::vector<std::string>{verb,         "dilys2021",
                                      "--run-dir",  path(verb),
                                      "--duration", fmt::format("{}ms", 0.2 * kHostileTicks)};
    };
    ASSERT_EQ(twinrate(arguments("simulate")).exit_code, 0);
    std::vector<std::string> launch = arguments("launch");
    launch.insert(launch.begin(), "twinrate");
    launch.insert(launch.end(), more.begin(), more.end());
    Program set(launch);
    ASSERT_TRUE(
        wait_until([&] { return !processes_with(path("launch"), "twinrate-plant").empty(); }));
    const auto words = arguments_of(processes_with(path("launch"), "twinrate-plant").front());
    const auto word = std::find(words.begin(), words.end(), "--session");
    ASSERT_NE(word, words.end());
    Attacker attacker(std::stoll(*(word + 1)), with_token ? path("launch") + "/token" : "");
    ASSERT_TRUE(wait_until([&] { return attacker.k() > 60; })) << set.err();
    for (int round = 0; round < 4; ++round) {
      attack(attacker);
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    const std::int64_t k_then = attacker.k();
    result_ = set.wait(30);
    ASSERT_FALSE(result_.timed_out) << result_.err;
    EXPECT_EQ(result_.exit_code, 0) << result_.err << result_.out;
    EXPECT_LT(k_then, kHostileTicks - 1) << "the run was over before the last message";
    EXPECT_GT(attacker.sent(), 500);
    EXPECT_TRUE(same_messages(path("launch"), path("simulate"), kHostileTicks));
  }
  static constexpr Role kSet[] = {Role::kPlant, Role::kEstimator, Role::kGain, Role::kController,
                                  Role::kLogger};
  ProgramResult result_;
};

TEST_F(Hostile, MessagesOfTheRightSessionChangeNoBit) {
  run({"--set", "bus.authenticate=false"}, [](Attacker& attacker) {
    send_malformed(attacker);
    send_of_the_future(attacker);
    send_of_the_past(attacker);
  });
  EXPECT_NE(result_.out.find("not authenticated"), std::string::npos) << result_.out;
  auto said = counted(path("launch"));
  for (const Role role : kSet) {
    EXPECT_GT(said[static_cast<int>(role)].first, 10) << role_name(static_cast<int>(role));
    EXPECT_GT(said[static_cast<int>(role)].second, 10) << role_name(static_cast<int>(role));
  }
}

TEST_F(Hostile, MessagesWithoutAValidTagChangeNoBit) {
  run({}, [](Attacker& attacker) {
    send_malformed(attacker);
    send_of_the_future(attacker);
    send_of_the_present(attacker);
  });
  EXPECT_NE(result_.out.find("messages refused"), std::string::npos) << result_.out;
  EXPECT_NE(result_.out.find("refused requests without a valid tag"), std::string::npos)
      << result_.out;
  auto said = counted(path("launch"));
  for (const Role role : kSet)
    EXPECT_GT(said[static_cast<int>(role)].second, 10) << role_name(static_cast<int>(role));
}

// A token shows that its holder may take part, not that it is the plant or the controller.
TEST_F(Hostile, MessagesOfASecondSenderWithTheTokenChangeNoBit) {
  run(
      {},
      [](Attacker& attacker) {
        send_of_the_future(attacker);
        send_of_the_past(attacker);
        send_of_the_present(attacker);
      },
      true);
  EXPECT_NE(result_.out.find("a second sender of DRIVE_"), std::string::npos) << result_.out;
}

}  // namespace
}  // namespace twinrate::test
