#include "core/sender_table.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <vector>

namespace twinrate {
namespace {

using Bytes = std::vector<std::uint8_t>;
constexpr SocketName kFirst = 0x100007f1234, kSecond = 0x100007f4321;

template <class Message>
Bytes encoded(const Message& message) {
  Bytes bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}
template <class Message>
Bytes of_role(Role role) {
  Message message{};
  message.role = static_cast<std::int32_t>(role);
  return encoded(message);
}
bool admits(SenderTable& table, const Bytes& bytes, Channel channel, SocketName sender) {
  return table.admits(channel, bytes.data(), sender);
}

TEST(SenderTable, TheFirstSenderOfAChannelIsTheOne) {
  SenderTable table;
  const Bytes command = encoded(command_t{});
  EXPECT_TRUE(admits(table, command, Channel::kCommand, kFirst));
  EXPECT_FALSE(admits(table, command, Channel::kCommand, kSecond));
  EXPECT_TRUE(admits(table, command, Channel::kCommand, kFirst));
  EXPECT_TRUE(admits(table, encoded(estimate_t{}), Channel::kEstimate, kSecond))
      << "another channel";
  EXPECT_TRUE(admits(table, command, Channel::kCommand, 0)) << "not told";
}

TEST(SenderTable, ARoleHasOneSenderOfItsStatusEventsAndReplies) {
  SenderTable table;
  EXPECT_TRUE(admits(table, of_role<status_t>(Role::kGain), Channel::kStatus, kFirst));
  EXPECT_TRUE(admits(table, of_role<status_t>(Role::kPlant), Channel::kStatus, kSecond));
  EXPECT_FALSE(admits(table, of_role<status_t>(Role::kGain), Channel::kStatus, kSecond));
  EXPECT_FALSE(admits(table, of_role<event_t>(Role::kGain), Channel::kEvent, kSecond));
  EXPECT_FALSE(admits(table, of_role<reply_t>(Role::kPlant), Channel::kReply, kFirst));
  EXPECT_TRUE(admits(table, of_role<event_t>(Role::kPlant), Channel::kEvent, kSecond));
  EXPECT_TRUE(admits(table, of_role<status_t>(Role::kLogger), Channel::kStatus, kFirst));
  EXPECT_FALSE(admits(table, encoded(ack_t{}), Channel::kAck, kSecond));
  for (const SocketName sender : {kFirst, kSecond})
    EXPECT_TRUE(admits(table, encoded(request_t{}), Channel::kRequest, sender));
}

TEST(SenderTable, ASecondSenderTakesThePlaceOfASilentOneOnly) {
  const auto wait = [] { usleep(SenderTable::kSilent_ns / 1000 + 20'000); };
  const Bytes gain = encoded(gain_t{}), status = of_role<status_t>(Role::kGain);
  for (const bool beats : {true, false}) {
    SenderTable table;
    EXPECT_TRUE(admits(table, gain, Channel::kGain, kFirst));
    EXPECT_TRUE(admits(table, status, Channel::kStatus, kFirst));
    EXPECT_FALSE(admits(table, gain, Channel::kGain, kSecond));
    wait();
    if (beats) admits(table, status, Channel::kStatus, kFirst);
    EXPECT_EQ(admits(table, gain, Channel::kGain, kSecond), !beats);
    EXPECT_EQ(admits(table, gain, Channel::kGain, kFirst), beats);
  }
  SenderTable table;
  EXPECT_TRUE(admits(table, gain, Channel::kGain, kFirst));
  table.forget(Role::kGain);
  EXPECT_TRUE(admits(table, gain, Channel::kGain, kSecond)) << "it was started again";
}

TEST(SenderTable, NamesASocketAsPeopleDo) {
  // 127.0.0.1 and port 4660 in network byte order, read as on this machine.
  EXPECT_EQ(text_of(std::uint64_t{0x0100007f} << 16 | 0x3412), "127.0.0.1 port 4660");
}

}  // namespace
}  // namespace twinrate
