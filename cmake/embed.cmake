# cmake -DFILES=A;B -DOUT=FILE -P embed.cmake: writes the files as a C++ source, the table of scope/assets.hpp.
set(tables "")
set(rows "")
set(number 0)
foreach(file ${FILES})
  file(READ ${file} hex HEX)
  get_filename_component(name ${file} NAME)
  string(LENGTH "${hex}" digits)
  math(EXPR bytes "${digits} / 2")
  string(REGEX REPLACE "([0-9a-f][0-9a-f])" "\\\\x\\1" text "${hex}")
  string(APPEND tables "constexpr char kFile${number}[] =\n    \"${text}\";\n")
  string(APPEND rows "    {\"${name}\", {kFile${number}, ${bytes}}},\n")
  math(EXPR number "${number} + 1")
endforeach()
file(WRITE ${OUT} "#include \"scope/assets.hpp\"

namespace twinrate::scope {
namespace {

${tables}
constexpr Asset kAssets[] = {
${rows}};

}  // namespace

std::span<const Asset> assets() {
  return kAssets;
}

}  // namespace twinrate::scope
")
