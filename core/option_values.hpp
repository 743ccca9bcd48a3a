// What the value of an option may be, for every program alike.
#pragma once

namespace CLI {
class App;
class Validator;
}  // namespace CLI

namespace twinrate {

// To be called when all options and verbs are there. Refuses an empty value (but for
// --channel-suffix, of which none is a suffix too), a number that is not finite, and a whole number
// that is none or needs more than 64 bits.
void expect_stated_values(CLI::App& app);

// For Option::check(). Those of CLI11 name the largest double, in 309 digits, as the end of the range.
CLI::Validator above_zero();
CLI::Validator zero_or_more();

}  // namespace twinrate
