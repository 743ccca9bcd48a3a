// Every effect's maker, one line an effect; its table stands in registry.cpp.
#pragma once
#include "model/effects/effect.hpp"

namespace twinrate {

std::shared_ptr<Effect> make_cogging();
std::shared_ptr<Effect> make_coulomb_friction();

}  // namespace twinrate
