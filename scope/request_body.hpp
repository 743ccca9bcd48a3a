// The values of a request's JSON body. BadInput names the key and the allowed values.
#pragma once
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "scope/trigger.hpp"

namespace twinrate::scope {

// "" without the key.
std::string text_in(const nlohmann::ordered_json& body, const char* key);

// A missing key keeps its default. A running trigger needs a signal or an event.
TriggerSettings trigger_settings(const nlohmann::ordered_json& body);

}  // namespace twinrate::scope
