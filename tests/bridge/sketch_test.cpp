// firmware/examples/simplefoc.ino against the host's side of the protocol.
#include "tests/bridge/sketch.hpp"

#include <gtest/gtest.h>

#include "bridge/twinrate_host.hpp"
#include "core/reason.hpp"

namespace twinrate::sketch_test {
namespace {

class Sketch : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { sketch::setup(); }
  void send(const Bytes& bytes) {
    sketch::board.in.insert(sketch::board.in.end(), bytes.begin(), bytes.end());
  }
  // A millisecond of the board; the sample of it.
  DriveSample tick() {
    sketch::board.us += 1000;
    sketch::loop();
    host_.take(std::exchange(sketch::board.out, {}), 1000 * std::int64_t{sketch::board.us});
    DriveSample last;
    while (const auto sample = host_.next()) last = *sample;
    return last;
  }
  Bytes command(const DriveSample& answers, double u_alpha) {
    DriveCommand c;
    c.command.u_alphabeta_ref = {u_alpha, 0};
    c.sample_k = answers.m.k;
    c.lease_us = 20'000;
    return host_.command(c);
  }
  TwinrateHost host_{false};
};

TEST_F(Sketch, DrivesUnderALeaseAndTellsTheVoltageOfTheIntervalBefore) {
  send(host_.hello(false));
  DriveSample sample = tick();
  ASSERT_TRUE(host_.info());
  EXPECT_EQ(host_.info()->name, "simplefoc");
  EXPECT_EQ(host_.info()->f_s_Hz, 1000);
  EXPECT_TRUE(host_.info()->watchdog);
  EXPECT_FALSE(sketch::board.enabled);

  send(command(sample, 2));
  sample = tick();  // the command came before it; its voltage begins with it
  EXPECT_TRUE(sketch::board.enabled);
  EXPECT_FLOAT_EQ(sketch::board.pwm[0], 12 + 2);
  EXPECT_FLOAT_EQ(sketch::board.pwm[1], 12 - 1);
  EXPECT_EQ(sample.m.u_alphabeta[0], 0);
  send(command(sample, 3));
  sample = tick();
  EXPECT_EQ(sample.m.u_alphabeta[0], 2);
  EXPECT_FLOAT_EQ(static_cast<float>(sample.m.theta_m), 0.5f);
  EXPECT_EQ(host_.counts().damaged, 0);

  for (int i = 0; i < 19; ++i) sample = tick();
  EXPECT_TRUE(sketch::board.enabled) << "the lease is 20 ms";
  for (int i = 0; i < 2; ++i) sample = tick();
  EXPECT_FALSE(sketch::board.enabled);
  sample = tick();
  EXPECT_TRUE(sample.off);
  EXPECT_EQ(sample.reason, static_cast<int>(Reason::kCommandLost));
  EXPECT_EQ(sample.m.u_alphabeta[0], 0);
  send(command(sample, 3));
  tick();
  EXPECT_FALSE(sketch::board.enabled) << "latched";
  send(host_.clear(sample.reason));
  sample = tick();
  send(command(sample, 1));
  tick();
  EXPECT_TRUE(sketch::board.enabled);

  sketch::board.i[1] = 4;
  tick();
  EXPECT_FALSE(sketch::board.enabled);
  sketch::board.i[1] = 0;
  sample = tick();
  EXPECT_EQ(sample.reason, static_cast<int>(Reason::kOverCurrent));
}

}  // namespace
}  // namespace twinrate::sketch_test
