// Allowed values of options, the same for every program.
#pragma once

namespace CLI {
class App;
class Validator;
}  // namespace CLI

namespace twinrate {

// To be called after all options and verbs were added. Refuses an empty value (except of
// --channel-suffix, where it means no suffix), a number that is not finite, and an integer option
// with a fraction or more than 64 bits.
void expect_stated_values(CLI::App& app);

// For Option::check(). Those of CLI11 name the largest double, in 309 digits, as the end of the range.
CLI::Validator above_zero();
CLI::Validator zero_or_more();

}  // namespace twinrate
