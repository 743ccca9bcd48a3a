// History, trigger and captures of the scope, on messages that the test makes.
#include "scope/recording.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <random>

#include "core/signals_io.hpp"

namespace twinrate::scope {
namespace {

template <class Message>
std::vector<std::uint8_t> encoded(const Message& message) {
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
  message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
  return bytes;
}

template <class Message>
void take(Recording& recording, const Message& message) {
  const auto bytes = encoded(message);
  recording.take(kChannelOf<Message>, bytes.data(), bytes.size(),
                 *read_header(bytes.data(), bytes.size()), 0);
}

constexpr double kT_s = 1e-4;

// A measurement whose i_a is the given value.
Measurement measurement(std::int64_t k, double i_a) {
  Measurement m;
  m.k = k;
  m.t_ns = k * 100'000;
  m.i_abc = {i_a, -i_a / 2, -i_a / 2};
  m.u_alphabeta = {1, 2};
  m.v_dc = 24;
  return m;
}

void fill(Recording& recording, const std::vector<double>& i_a, std::int64_t first = 0) {
  for (std::size_t k = 0; k < i_a.size(); ++k)
    take(recording, to_wire(measurement(first + static_cast<std::int64_t>(k), i_a[k]), 7));
}

std::vector<double> noise(std::size_t count) {
  std::mt19937_64 generator(1);
  std::normal_distribution<double> normal;
  std::vector<double> list(count);
  for (double& value : list) value = normal(generator);
  return list;
}

constexpr const char* kI_a = "measurement.i_a_A";

TEST(MessageLayout, ReadsTheFieldsOfAnEstimate) {
  Estimate e;
  e.k = 41;
  e.theta_e = 1.25;
  e.omega_m = -3;
  e.n_x = 4;
  e.n_y = 2;
  e.x_hat.head(4) << 1, 2, 3, 4;
  e.innov.head(2) << 5, 6;
  const auto bytes = encoded(to_wire(e, 7));
  const MessageLayout& layout = layout_of(Channel::kEstimate);
  std::map<std::string, std::vector<double>> found;
  read_numbers(layout, bytes.data(), bytes.size(), [&](int field, int, double value) {
    found[layout.fields[static_cast<std::size_t>(field)].wire].push_back(value);
  });
  EXPECT_EQ(found["seq"], std::vector<double>{41});
  EXPECT_EQ(found["theta_e_rad"], std::vector<double>{1.25});
  EXPECT_EQ(found["omega_m_rad_s"], std::vector<double>{-3});
  EXPECT_EQ(found["x_hat"], (std::vector<double>{1, 2, 3, 4}));
  EXPECT_EQ(found["innov"], (std::vector<double>{5, 6}));
}

TEST(MessageLayout, GivesEveryChannelNamesUnitsAndComments) {
  for (const ChannelInfo& channel : kChannels)
    EXPECT_GE(layout_of(channel.channel).fields.size(), 4u);
  for (const LayoutField& field : layout_of(Channel::kMeasurement).fields)
    if (field.wire == "i_b_A") {
      EXPECT_EQ(field.unit, "A");
      EXPECT_EQ(field.comment, "phase currents, positive into the motor");
    }
}

TEST(MessageLayout, AMessageThatEndsEarlyGivesTheFieldsItHas) {
  const auto bytes = encoded(to_wire(measurement(3, 1), 7));
  int count = 0;
  read_numbers(layout_of(Channel::kMeasurement), bytes.data(), 40,
               [&](int, int, double) { ++count; });
  EXPECT_EQ(count, 4);  // seq, t_ns, session, signals; then 4 bytes of a double
}

TEST(History, ABucketHasThePeakOfOneTick) {
  std::vector<double> i_a = noise(30'000);
  i_a[12'345] = 99;
  i_a[20'001] = -77;
  Recording recording(60, 256 << 20);
  fill(recording, i_a);
  for (const std::int64_t bucket : {1, 7, 64, 1024, 4096}) {
    const Reduced reduced = recording.reduce(kI_a, {0, 30'000, bucket, 0});
    for (std::size_t b = 0; b < reduced.min.size(); ++b) {
      const auto begin = i_a.begin() + static_cast<std::ptrdiff_t>(b) * bucket;
      const auto end = std::min(begin + bucket, i_a.end());
      ASSERT_EQ(reduced.min[b], *std::min_element(begin, end)) << bucket;
      ASSERT_EQ(reduced.max[b], *std::max_element(begin, end)) << bucket;
    }
  }
}

TEST(History, StatisticsAreOfEveryTickOnce) {
  const std::vector<double> i_a = noise(10'000);
  Recording recording(60, 256 << 20);
  fill(recording, i_a);
  fill(recording, {i_a.begin() + 5000, i_a.begin() + 5100}, 5000);  // sent again
  const Extent e = recording.extent(kI_a, {101, 9'901, 1, 0});
  double sum = 0, squares = 0;
  for (std::size_t k = 101; k < 9'901; ++k) sum += i_a[k], squares += i_a[k] * i_a[k];
  EXPECT_EQ(e.count, 9'800);
  EXPECT_NEAR(e.sum, sum, 1e-9);
  EXPECT_NEAR(e.sum_of_squares, squares, 1e-7);
}

TEST(History, IsARing) {
  Recording recording(1e9, 20 * kChunkTicks * 560);
  fill(recording, noise(200'000));
  EXPECT_GT(recording.first_k(), 200'000 - 23 * kChunkTicks);
  EXPECT_LT(recording.first_k(), 200'000 - 18 * kChunkTicks);
  EXPECT_EQ(recording.last_k(), 199'999);
  EXPECT_TRUE(std::isnan(recording.samples(kI_a, {0, 1, 1, 0}).front()));
}

TEST(History, PairsEstimateAndTruthOfTheSameTick) {
  Recording recording(60, 64 << 20);
  recording.use_config("preset = \"dilys2021\"\n", "test");  // n_p = 4
  const auto theta_m = [](std::int64_t k) { return 0.02 * static_cast<double>(k); };
  for (std::int64_t k = 0; k < 200; ++k) {
    Truth truth;
    truth.k = k;
    truth.theta_m = theta_m(k);
    take(recording, to_wire(truth, 7));
    Estimate e;  // arrives three ticks later
    e.k = k - 3;
    e.theta_e = std::remainder(4 * theta_m(e.k) + 0.1, 2 * M_PI);
    if (e.k >= 0) take(recording, to_wire(e, 7));
  }
  for (const double error : recording.samples("drive.angle_error_rad", {0, 197, 1, 0}))
    ASSERT_NEAR(error, 0.1, 1e-12);
}

TriggerSettings rising(double level) {
  TriggerSettings t;
  t.mode = TriggerMode::kNormal;
  t.signal = kI_a;
  t.level = level;
  t.length_ticks = 100;
  return t;
}

TEST(Captures, HoldEveryTickAroundTheTrigger) {
  std::vector<double> i_a(20'000);
  for (std::size_t k = 0; k < i_a.size(); ++k) i_a[k] = std::sin(0.01 * static_cast<double>(k));
  Recording recording(60, 64 << 20);
  TriggerSettings t = rising(0.5);
  t.pre_share = 0.25;
  recording.set_trigger(t);
  fill(recording, i_a);
  const auto captures = recording.brief()["captures"];
  ASSERT_EQ(captures.size(), kCapturesKept);
  EXPECT_EQ(captures.back()["id"], 32);  // turns of 628 ticks
  for (const auto& c : captures) {
    const std::int64_t k = c["trigger_k"], from = c["from"], to = c["to"];
    EXPECT_EQ(c["missing"], 0);
    EXPECT_EQ(from, k - 25);
    EXPECT_EQ(to, k + 75);
    EXPECT_LT(i_a[static_cast<std::size_t>(k - 1)], 0.5);
    EXPECT_GE(i_a[static_cast<std::size_t>(k)], 0.5);
    const auto held = recording.samples(kI_a, {from, to, 1, c["id"]});
    for (std::int64_t j = from; j < to; ++j)
      ASSERT_EQ(held[static_cast<std::size_t>(j - from)], i_a[static_cast<std::size_t>(j)]);
  }
}

TEST(Captures, CountTicksThatDidNotArrive) {
  Recording recording(60, 64 << 20);
  recording.set_trigger(rising(0.5));
  std::vector<double> i_a(1000, 0.0);
  i_a[500] = 1;
  for (std::int64_t k = 0; k < 1000; ++k)
    if (k < 510 || k >= 513)
      take(recording, to_wire(measurement(k, i_a[static_cast<std::size_t>(k)]), 7));
  const auto captures = recording.brief()["captures"];
  ASSERT_EQ(captures.size(), 1u);
  EXPECT_EQ(captures[0]["missing"], 3);
}

// A repeat may overtake the tick before it; what never comes is missing in the capture, on any channel.
TEST(Captures, WaitForALateTickAndCountALostOneOfEveryChannel) {
  for (const std::int64_t lost : {0, 521}) {
    Recording recording(60, 64 << 20);
    recording.set_trigger(rising(0.5));
    std::vector<double> i_a(1000, 0.0);
    i_a[500] = 1;
    for (std::int64_t k = 0; k < 1000; ++k) {
      take(recording, to_wire(measurement(k, i_a[static_cast<std::size_t>(k)]), 7));
      Truth truth;
      truth.k = k == 549 ? 550 : k == 550 ? 549 : k;  // 550 overtakes: the capture ends at 550
      if (lost == 0 || k != lost) take(recording, to_wire(truth, 7));
    }
    const auto captures = recording.brief()["captures"];
    ASSERT_EQ(captures.size(), 1u);
    EXPECT_EQ(captures[0]["to"], 550);
    EXPECT_EQ(captures[0]["missing"], lost == 0 ? 0 : 1);
  }
}

TEST(Captures, OutliveTheRing) {
  Recording recording(1e9, 4 * kChunkTicks * 560);
  recording.set_trigger(rising(0.5));
  std::vector<double> i_a(100'000, 0.0);
  i_a[300] = 1;
  fill(recording, i_a);
  EXPECT_GT(recording.first_k(), 300);
  EXPECT_EQ(recording.samples(kI_a, {300, 301, 1, 1}).front(), 1);
}

TEST(TriggerTest, AnEventBeginsACapture) {
  Recording recording(60, 64 << 20);
  TriggerSettings t = rising(0);
  t.signal = "";
  t.event = "trip";
  recording.set_trigger(t);
  fill(recording, std::vector<double>(400, 0.0));
  event_t event{};
  event.seq = 390;
  event.session = 7;
  event.reason = 1;  // mode_change is no trip
  event.text = "x";
  take(recording, event);
  event.reason = 72;  // over_current
  take(recording, event);
  fill(recording, std::vector<double>(400, 0.0), 400);
  const auto captures = recording.brief()["captures"];
  ASSERT_EQ(captures.size(), 1u);
  EXPECT_EQ(captures[0]["trigger_k"], 390);
  EXPECT_EQ(captures[0]["cause"], "event over_current");
}

// The ticks at which it fires.
std::vector<std::int64_t> fired(const TriggerSettings& settings,
                                const std::vector<double>& values) {
  Trigger trigger;
  trigger.set(settings);
  std::vector<std::int64_t> list;
  for (std::size_t k = 0; k < values.size(); ++k)
    if (trigger.sample(static_cast<std::int64_t>(k), values[k]))
      list.push_back(static_cast<std::int64_t>(k));
  return list;
}

TEST(TriggerTest, HysteresisKeepsNoiseFromFiring) {
  TriggerSettings t = rising(1);
  t.length_ticks = 2;
  t.pre_share = 1;
  const std::vector<double> values = {0, 1.1, 0.9, 1.1, 0.9, 1.1, 0, 1.1};
  EXPECT_EQ(fired(t, values), (std::vector<std::int64_t>{1, 3, 5, 7}));
  t.hysteresis = 0.5;
  EXPECT_EQ(fired(t, values), (std::vector<std::int64_t>{1, 7}));
  t.edge = Edge::kFalling;
  t.level = 0.5;
  t.hysteresis = 0.3;
  EXPECT_EQ(fired(t, values), (std::vector<std::int64_t>{6}));
}

TEST(TriggerTest, DoesNotFireAtAStartAboveTheLevel) {
  EXPECT_TRUE(fired(rising(1), {2, 2, 2}).empty());
}

TEST(TriggerTest, HoldOffAndSingle) {
  TriggerSettings t = rising(1);
  t.length_ticks = 4;
  t.pre_share = 0.25;
  t.holdoff_ticks = 3;
  std::vector<double> values;
  values.reserve(12);
  for (int i = 0; i < 12; ++i) values.push_back(i % 2 ? 2 : 0);
  EXPECT_EQ(fired(t, values),
            (std::vector<std::int64_t>{1, 7}));  // 3 ticks after it, 3 of hold-off
  t.mode = TriggerMode::kSingle;
  EXPECT_EQ(fired(t, values), (std::vector<std::int64_t>{1}));
}

TEST(TriggerTest, AChangeAfterRestFires) {
  TriggerSettings t = rising(0);
  t.edge = Edge::kChange;
  std::vector<double> values(40, 5.0);
  values.resize(60, 6.0);
  EXPECT_EQ(fired(t, values), (std::vector<std::int64_t>{40}));
}

}  // namespace
}  // namespace twinrate::scope
