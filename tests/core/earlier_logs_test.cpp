// Logs of earlier wire schemas are read; those of later ones are refused.
#include <gtest/gtest.h>

#include <filesystem>
#include <lcm/lcm-cpp.hpp>
#include <twinrate/event_v2_t.hpp>

#include "core/config.hpp"
#include "core/decode.hpp"
#include "core/make_event.hpp"
#include "core/manifest.hpp"
#include "core/run_log.hpp"

namespace twinrate {
namespace {

template <class Message>
std::vector<std::uint8_t> bytes_of(const Message& message) {
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}

event_v2_t event_of_schema_2() {
  event_v2_t event{};
  event.seq = 17;
  event.t_ns = 3'400'000;
  event.session = 9;
  event.role = static_cast<int>(Role::kEstimator);
  event.reason = static_cast<int>(Reason::kLateGain);
  event.text = "a gain was late";
  return event;
}

// One MEASUREMENT and one event as the schema has it.
template <class Event>
RunLog log_of(int schema, const Event& event, const std::string& config = "") {
  const std::filesystem::path path =
      std::filesystem::temp_directory_path() / ("twinrate-schema-" + std::to_string(getpid()));
  {
    lcm::LogFile file(path.string(), "w");
    const auto append = [&](Channel channel, std::vector<std::uint8_t> bytes) {
      lcm::LogEvent entry{};
      entry.channel = info(channel).name;
      entry.data = bytes.data();
      entry.datalen = static_cast<int>(bytes.size());
      file.writeEvent(&entry);
    };
    manifest_t manifest = make_manifest(9, config, "{}");
    manifest.schema = schema;
    append(Channel::kManifest, bytes_of(manifest));
    append(Channel::kMeasurement, bytes_of(measurement_t{}));
    append(Channel::kEvent, bytes_of(event));
  }
  struct Removed {
    std::filesystem::path path;
    ~Removed() { std::filesystem::remove(path); }
  } const removed{path};
  return read_run_log(path.string());
}

TEST(EarlierLogs, OfSchema2HaveEventsThatWaitForNobody) {
  const RunLog log = log_of(2, event_of_schema_2());
  ASSERT_EQ(log.events.size(), 1u);
  EXPECT_EQ(log.events[0].k, 17);
  EXPECT_EQ(log.events[0].t_ns, 3'400'000);
  EXPECT_EQ(log.events[0].role, static_cast<int>(Role::kEstimator));
  EXPECT_EQ(log.events[0].reason, static_cast<int>(Reason::kLateGain));
  EXPECT_EQ(log.events[0].text, "a gain was late");
  EXPECT_EQ(log.events[0].waited_for, -1);
}

TEST(EarlierLogs, OfThisSchemaSayWhoWasWaitedFor) {
  const RunLog log = log_of(kWireSchema, make_event({.role = Role::kController,
                                                     .reason = Reason::kPeerTimeout,
                                                     .k = 4,
                                                     .waited_for = Role::kEstimator}));
  ASSERT_EQ(log.events.size(), 1u);
  EXPECT_EQ(log.events[0].role, static_cast<int>(Role::kController));
  EXPECT_EQ(log.events[0].waited_for, static_cast<int>(Role::kEstimator));
}

TEST(EarlierLogs, BeforeSchema4NoFilterWaitedForItsAgreement) {
  const std::string config = "name = \"d\"\n\n[rates]\nn = 5\n";
  EXPECT_EQ(log_of(2, event_of_schema_2(), config).config_toml,
            "name = \"d\"\n\n[rates]\nn_from = \"start\"\nn = 5\n");
  EXPECT_EQ(log_of(kWireSchema, event_t{}, config).config_toml, config);
}

TEST(EarlierLogs, OfSchemasThatNobodyHereKnowsAreRefused) {
  for (const int schema : {kOldestWireSchema - 1, kWireSchema + 1})
    EXPECT_THROW(log_of(schema, event_of_schema_2()), BadInput) << schema;
}

TEST(Decode, RefusesAnEventOfNoSchema) {
  std::vector<std::uint8_t> bytes = bytes_of(event_of_schema_2());
  event_t event;
  EXPECT_TRUE(decode(event, bytes.data(), bytes.size()));
  EXPECT_EQ(event.session, 9);
  bytes[3] ^= 1;  // the fingerprint
  EXPECT_FALSE(decode(event, bytes.data(), bytes.size()));
}

}  // namespace
}  // namespace twinrate
