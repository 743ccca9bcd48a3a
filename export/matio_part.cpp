// The part `matio`.
#include "core/load_part.hpp"
#include "export/matio_functions.hpp"

TWINRATE_PART const twinrate::MatioFunctions twinrate_part;
const twinrate::MatioFunctions twinrate_part = {
    .create = Mat_CreateVer,
    .close = Mat_Close,
    .variable = Mat_VarCreate,
    .structure = Mat_VarCreateStruct,
    .set_cell = Mat_VarSetCell,
    .set_field = Mat_VarSetStructFieldByName,
    .write = Mat_VarWrite,
    .free = Mat_VarFree,
};
