// JSON Schema (draft 7) of a drive file, from the field lists that read it: keys, types, ranges and
// choices. An editor that knows TOML schemas completes and checks with it.
#pragma once
#include <string>

namespace twinrate {

std::string drive_schema();

}  // namespace twinrate
