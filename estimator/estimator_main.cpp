// twinrate-estimator: the fast correction loop with the filter of the drive file.
#include "estimator/estimator_process.hpp"

int main(int argc, char** argv) {
  return twinrate::run_estimator("twinrate-estimator", argc, argv, twinrate::make_filter);
}
