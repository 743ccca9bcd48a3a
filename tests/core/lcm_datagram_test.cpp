// LCM's datagrams: what is sent comes together again, and what is announced costs nothing.
#include "core/lcm_datagram.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>

#include "core/message_check.hpp"
#include "model/random.hpp"

namespace twinrate {
namespace {

using Bytes = std::vector<std::uint8_t>;
using Outcome = Reassembly::Outcome;

Bytes payload_of(std::size_t size) {
  Bytes bytes(size);
  for (std::size_t i = 0; i < size; ++i) bytes[i] = static_cast<std::uint8_t>(splitmix64(i));
  return bytes;
}

std::vector<Bytes> datagrams_of(const std::string& channel, const Bytes& payload,
                                std::uint32_t sequence = 7) {
  std::vector<Bytes> list;
  Datagrams datagrams(channel, payload.data(), payload.size(), sequence);
  while (datagrams.next()) {
    Bytes one(datagrams.header(), datagrams.header() + datagrams.header_size());
    if (datagrams.names_channel())
      one.insert(one.end(), channel.c_str(), channel.c_str() + channel.size() + 1);
    one.insert(one.end(), datagrams.payload(), datagrams.payload() + datagrams.payload_size());
    list.push_back(one);
  }
  return list;
}

struct Taken {
  int whole = 0, malformed = 0;
  std::string channel;
  Bytes bytes;
};
Taken take_all(Reassembly& reassembly, const std::vector<Bytes>& datagrams,
               std::uint64_t sender = 1, std::int64_t now_ns = 0) {
  Taken taken;
  for (const Bytes& d : datagrams) {
    LcmMessage message;
    const Outcome outcome = reassembly.take(d.data(), d.size(), sender, now_ns, message);
    if (outcome == Outcome::kMalformed) ++taken.malformed;
    if (outcome != Outcome::kWhole) continue;
    ++taken.whole;
    taken.channel = message.channel;
    taken.bytes.assign(message.bytes, message.bytes + message.size);
  }
  return taken;
}

// Announces `size` bytes and brings four.
Bytes announcement(std::uint32_t sequence, std::uint32_t size, std::uint32_t offset,
                   std::uint16_t number, std::uint16_t count) {
  Bytes d = {'L', 'C', '0', '3'};
  for (const std::uint32_t word : {sequence, size, offset})
    for (int i = 24; i >= 0; i -= 8) d.push_back(static_cast<std::uint8_t>(word >> i));
  for (const std::uint16_t half : {number, count}) {
    d.push_back(static_cast<std::uint8_t>(half >> 8));
    d.push_back(static_cast<std::uint8_t>(half));
  }
  d.insert(d.end(), {'A', 0, 1, 2});
  return d;
}

TEST(LcmDatagram, OneDatagramHoldsAMessageUpToItsLimit) {
  for (const std::size_t size : {std::size_t{0}, std::size_t{1}, kMaxWhole - 8, kMaxWhole - 7}) {
    const Bytes payload = payload_of(size);
    const auto datagrams = datagrams_of("CHANNEL", payload);
    EXPECT_EQ(datagrams.size(), size + 8 > kMaxWhole ? 2u : 1u) << size;
    Reassembly reassembly;
    const Taken taken = take_all(reassembly, datagrams);
    EXPECT_EQ(taken.whole, 1);
    EXPECT_EQ(taken.channel, "CHANNEL");
    EXPECT_EQ(taken.bytes, payload);
  }
}

TEST(LcmDatagram, FragmentsInAnyOrderAndTwiceMakeTheMessage) {
  const Bytes payload = payload_of(300'000);
  auto datagrams = datagrams_of("CHANNEL", payload);
  ASSERT_EQ(datagrams.size(), 5u);
  std::reverse(datagrams.begin(), datagrams.end());
  datagrams.insert(datagrams.begin() + 2, datagrams[1]);
  Reassembly reassembly;
  const Taken taken = take_all(reassembly, datagrams);
  EXPECT_EQ(taken.whole, 1);
  EXPECT_EQ(taken.bytes, payload);
  EXPECT_EQ(reassembly.bytes_held(), 0u);
}

TEST(LcmDatagram, SendersAreKeptApart) {
  const Bytes a = payload_of(200'000), b(200'000, 9);
  const auto from_a = datagrams_of("A", a), from_b = datagrams_of("B", b);
  Reassembly reassembly;
  Taken first, second;
  for (std::size_t i = 0; i < from_a.size(); ++i) {
    first = take_all(reassembly, {from_a[i]}, 1);
    second = take_all(reassembly, {from_b[i]}, 2);
  }
  EXPECT_EQ(first.bytes, a);
  EXPECT_EQ(second.bytes, b);
}

TEST(LcmDatagram, AnIncompleteMessageIsGivenUpAfterItsTime) {
  const auto datagrams = datagrams_of("CHANNEL", payload_of(200'000));
  Reassembly reassembly;
  take_all(reassembly, {datagrams[0]}, 1, 0);
  EXPECT_GT(reassembly.bytes_held(), 0u);
  take_all(reassembly, {announcement(9, 100, 0, 0, 2)}, 2, kReassemblyPatience_ns + 1);
  EXPECT_EQ(reassembly.given_up(), 1);
  EXPECT_LE(reassembly.bytes_held(), 100u);
}

TEST(LcmDatagram, AnnouncedSizesCostNoMemory) {
  Reassembly reassembly;
  const auto largest = static_cast<std::uint32_t>(kMaxMessageBytes);
  for (std::uint32_t i = 0; i < 2000; ++i) {
    LcmMessage message;
    for (const Bytes& d :
         {announcement(i, 0xffffffff, 0, 0, 0xffff), announcement(i, largest + 1, 0, 0, 2),
          announcement(i, 100, 0xffffff00, 1, 2), announcement(i, 100, 0, 2, 2),
          announcement(i, 0, 0, 0, 0), announcement(i, 3, 0, 1, 2)})
      EXPECT_EQ(reassembly.take(d.data(), d.size(), i, 0, message), Outcome::kMalformed);
    const Bytes far = announcement(i, largest, largest - 4, 1, 2);
    EXPECT_EQ(reassembly.take(far.data(), far.size(), i, 0, message), Outcome::kPart);
    ASSERT_LE(reassembly.bytes_held(), kMaxReassemblyBytes);
  }
}

TEST(LcmDatagram, ChannelsWithoutEndAreMalformed) {
  Reassembly reassembly;
  for (const std::size_t length : {std::size_t{0}, kMaxChannelLength + 1}) {
    const auto datagrams = datagrams_of(std::string(length, 'x'), payload_of(10));
    EXPECT_EQ(take_all(reassembly, datagrams).malformed, 1) << length;
  }
  Bytes endless = {'L', 'C', '0', '2', 0, 0, 0, 1, 'x', 'y'};
  EXPECT_EQ(take_all(reassembly, {endless}).malformed, 1);
}

TEST(LcmDatagram, NoDatagramEndsTheReceiverOrGrowsIt) {
  Reassembly reassembly;
  const auto genuine = datagrams_of("CHANNEL", payload_of(140'000));
  int whole = 0;
  for (std::uint64_t i = 0; i < 20'000; ++i) {
    Bytes d = genuine[i % genuine.size()];
    d.resize(splitmix64(2 * i) % 200);
    for (std::uint64_t j = 0; j < 4 && !d.empty(); ++j)
      d[splitmix64(i * 8 + j) % std::min<std::size_t>(d.size(), 24)] =
          static_cast<std::uint8_t>(splitmix64(i * 16 + j));
    LcmMessage message;
    if (reassembly.take(d.data(), d.size(), i % 20, static_cast<std::int64_t>(i), message) ==
        Outcome::kWhole)
      ++whole;
    ASSERT_LE(reassembly.bytes_held(), kMaxReassemblyBytes);
  }
  EXPECT_LT(whole, 1000) << "nearly none of them is a message";
  EXPECT_EQ(take_all(reassembly, genuine, 77).whole, 1);
}

}  // namespace
}  // namespace twinrate
