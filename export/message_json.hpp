// A message as JSON, and its JSON schema: for MCAP files and for the websocket of Foxglove.
//
// Integers have all their digits. A number that is not finite is null.
#pragma once
#include <string>

#include "export/fields.hpp"

namespace twinrate {

std::string message_schema(const Layout& layout);
std::string message_json(const Layout& layout, const Sample& sample);

}  // namespace twinrate
