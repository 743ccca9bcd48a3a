// No option without an effect, on a sample; bench/silent_options sets every option of every pairing.
#include "tests/support/option_probe.hpp"

#include <gtest/gtest.h>

namespace twinrate::test {
namespace {

void expect_no_silent_option(const Pairing& pairing, std::size_t first, std::size_t every) {
  const std::vector<Option> options = options_of(pairing);
  OptionProber prober(pairing);
  for (std::size_t i = first; i < options.size(); i += every) {
    const OptionProbe probe = prober.probe(options[i]);
    EXPECT_NE(probe.answer, OptionAnswer::kSilent) << options[i].key;
    EXPECT_NE(probe.answer, OptionAnswer::kError) << options[i].key << ": " << probe.why;
  }
}

TEST(Options, NoneOfASampleIsSilentUnderFoc) {
  expect_no_silent_option({"kim-ipmsm", "eemf", "foc", "flying"}, 0, 9);
}
TEST(Options, NoneOfASampleIsSilentUnderStateFeedback) {
  expect_no_silent_option({"dilys2021", "ekf_disturbance", "lqr", "flying"}, 4, 23);
}

TEST(Options, OneThatChangesNothingIsFound) {
  OptionProber prober({"kim-ipmsm", "dq_ekf", "foc", "flying"});
  EXPECT_EQ(prober.probe({"plant.delay_samples", {}, {"1"}}).answer, OptionAnswer::kSilent);
  EXPECT_EQ(prober.probe({"plant.delay_samples", {}, {"2"}}).answer, OptionAnswer::kChanges);
  EXPECT_EQ(prober.probe({"plant.erk_steps", {}, {"3"}}).answer, OptionAnswer::kChanges)
      << "with plant.engine = erk";
  EXPECT_EQ(prober.probe({"estimator.eemf.R_diag", {}, {"[1, 1]"}}).answer, OptionAnswer::kRefused);
}

}  // namespace
}  // namespace twinrate::test
