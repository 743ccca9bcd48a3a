// Ten lines against the installed package: a message and the model.
#include <cstdio>
#include <twinrate/measurement_t.hpp>

#include "model/frames.hpp"

int main() {
  const twinrate::measurement_t m{};
  const twinrate::Vec2 turned = twinrate::rotate({1, 0}, twinrate::kPi / 2);
  std::printf("%d %.3f\n", m.getEncodedSize() > 0, turned[1]);
}
