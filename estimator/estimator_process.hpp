// The process of an estimator around any filter.
//
//   MEASUREMENT(k), GAIN(s) -> [FastLoop::tick] -> ESTIMATE(k)
//
// twinrate-estimator runs it with the filter of the drive file. A program of your own runs it with
// its own filter (estimator/own_filter.hpp):
//
//   int main(int argc, char** argv) {
//     return twinrate::run_estimator("my_filter", argc, argv, twinrate::own_filter<MyFilter>);
//   }
#pragma once
#include "estimator/make_filter.hpp"

namespace twinrate {

// Reads the options of every process (--help lists them) and runs until the end of the drive.
// `program`: its name in messages. Returns the exit code.
int run_estimator(const char* program, int argc, char** argv, const MakeFilter& make);

}  // namespace twinrate
