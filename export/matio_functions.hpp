// The functions of matio that the export calls: the part `matio` (core/load_part.hpp).
#pragma once
#include <matio.h>

namespace twinrate {

struct MatioFunctions {
  decltype(&Mat_CreateVer) create;
  decltype(&Mat_Close) close;
  decltype(&Mat_VarCreate) variable;
  decltype(&Mat_VarCreateStruct) structure;
  decltype(&Mat_VarSetCell) set_cell;
  decltype(&Mat_VarSetStructFieldByName) set_field;
  decltype(&Mat_VarWrite) write;
  decltype(&Mat_VarFree) free;
};

}  // namespace twinrate
