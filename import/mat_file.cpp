#include "import/mat_file.hpp"

#include <fmt/format.h>
#include <zlib.h>

#include <algorithm>
#include <bit>
#include <cstring>
#include <fstream>
#include <limits>
#include <map>
#include <span>

#include "core/config.hpp"

namespace twinrate {
namespace {

using Bytes = std::span<const std::uint8_t>;
using Kind = MatVariable::Kind;

// Table 1-1 of the format: types of data. Table 1-3: classes of arrays.
enum Type : std::uint32_t {
  kInt8 = 1,
  kUint8 = 2,
  kInt16 = 3,
  kUint16 = 4,
  kInt32 = 5,
  kUint32 = 6,
  kSingle = 7,
  kDouble = 9,
  kInt64 = 12,
  kUint64 = 13,
  kMatrix = 14,
  kCompressed = 15,
  kUtf8 = 16,
  kUtf16 = 17,
};
enum Class : std::uint32_t {
  kCellClass = 1,
  kStructClass = 2,
  kCharClass = 4,
  kDoubleClass = 6,
  kInt64Class = 14,
  kUint64Class = 15,
};
constexpr std::uint32_t kComplexFlag = 0x800;
constexpr std::size_t kHeaderBytes = 128;
constexpr int kMaxDepth = 16;
constexpr std::size_t kMaxCells = 1 << 21;

struct Damaged {
  std::string what;
};

template <class Number>
Number number_at(Bytes bytes, std::size_t at) {
  Number value;
  std::memcpy(&value, bytes.data() + at, sizeof value);
  return value;
}

struct Element {
  std::uint32_t type = 0;
  Bytes data;
};

// Data elements one after the other, each with its tag and padded to 8 bytes.
class Elements {
 public:
  explicit Elements(Bytes bytes) : bytes_(bytes) {}
  bool at_end() const { return at_ + 8 > bytes_.size(); }
  Element next() {
    if (at_end()) throw Damaged{"a data element is missing"};
    const auto first = number_at<std::uint32_t>(bytes_, at_);
    if (first >> 16) {  // small form: length and type in four bytes, data in four
      const std::size_t length = first >> 16;
      if (length > 4) throw Damaged{"a short data element is longer than 4 bytes"};
      const Element element{first & 0xffff, bytes_.subspan(at_ + 4, length)};
      at_ += 8;
      return element;
    }
    const std::size_t length = number_at<std::uint32_t>(bytes_, at_ + 4);
    if (length > bytes_.size() - at_ - 8)
      throw Damaged{fmt::format("a data element of {} bytes where {} are left", length,
                                bytes_.size() - at_ - 8)};
    const Element element{first, bytes_.subspan(at_ + 8, length)};
    at_ += 8 + (first == kCompressed ? length : (length + 7) / 8 * 8);
    return element;
  }
  Element next(std::uint32_t type, const char* what) {
    const Element element = next();
    if (element.type != type) throw Damaged{fmt::format("{} is not where it belongs", what)};
    return element;
  }

 private:
  Bytes bytes_;
  std::size_t at_ = 0;
};

std::string text_of(Bytes bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

template <class Stored, class Number>
std::vector<Number> converted(Bytes data) {
  std::vector<Number> numbers(data.size() / sizeof(Stored));
  for (std::size_t i = 0; i < numbers.size(); ++i)
    numbers[i] = static_cast<Number>(number_at<Stored>(data, i * sizeof(Stored)));
  return numbers;
}

std::size_t bytes_of(std::uint32_t type) {
  if (type == kInt8 || type == kUint8) return 1;
  if (type == kInt16 || type == kUint16) return 2;
  return type == kInt32 || type == kUint32 || type == kSingle ? 4 : 8;
}

template <class Number>
std::vector<Number> numbers_of(const Element& element) {
  switch (element.type) {
    case kInt8: {
      std::vector<Number> numbers = converted<std::uint8_t, Number>(element.data);
      for (Number& number : numbers)
        if (number > 127) number -= 256;
      return numbers;
    }
    case kUint8:
      return converted<std::uint8_t, Number>(element.data);
    case kInt16:
      return converted<std::int16_t, Number>(element.data);
    case kUint16:
      return converted<std::uint16_t, Number>(element.data);
    case kInt32:
      return converted<std::int32_t, Number>(element.data);
    case kUint32:
      return converted<std::uint32_t, Number>(element.data);
    case kInt64:
      return converted<std::int64_t, Number>(element.data);
    case kUint64:
      return converted<std::uint64_t, Number>(element.data);
    default:
      break;
  }
  if constexpr (std::is_same_v<Number, double>) {
    if (element.type == kSingle) return converted<float, Number>(element.data);
    if (element.type == kDouble) return converted<double, Number>(element.data);
  }
  throw Damaged{fmt::format("numbers of type {}", element.type)};
}

class MatReader {
 public:
  std::vector<MatVariable> read(Bytes file) {
    std::vector<MatVariable> variables;
    take(Elements(file.subspan(kHeaderBytes)), variables);
    return variables;
  }

 private:
  void take(Elements elements, std::vector<MatVariable>& variables) {
    while (!elements.at_end()) {
      const Element element = elements.next();
      if (element.type == kCompressed) {
        // One matrix. Its length is not compared: matio writes 8 too many for a short text.
        const std::vector<std::uint8_t> unpacked = unpack(element.data);
        if (unpacked.size() < 8 || number_at<std::uint32_t>(unpacked, 0) != kMatrix)
          throw Damaged{"a packed variable is no matrix"};
        variables.push_back(matrix(Bytes(unpacked).subspan(8), 0));
      } else if (element.type == kMatrix) {
        variables.push_back(matrix(element.data, 0));
      }
    }
  }

  std::vector<std::uint8_t> unpack(Bytes data) {
    std::vector<std::uint8_t> out;
    z_stream stream{};
    if (inflateInit(&stream) != Z_OK) throw Damaged{"a packed variable cannot be unpacked"};
    stream.next_in = const_cast<std::uint8_t*>(data.data());
    stream.avail_in = static_cast<unsigned>(data.size());
    int result = Z_OK;
    while (result == Z_OK) {
      const std::size_t done = out.size();
      const std::size_t step = std::max<std::size_t>(1 << 16, done / 2);
      if (unpacked_ + step > kMaxMatBytes) break;
      unpacked_ += step;
      out.resize(done + step);
      stream.next_out = out.data() + done;
      stream.avail_out = static_cast<unsigned>(step);
      result = inflate(&stream, Z_NO_FLUSH);
      out.resize(out.size() - stream.avail_out);
      unpacked_ -= stream.avail_out;
    }
    inflateEnd(&stream);
    if (result == Z_OK)
      throw Damaged{fmt::format("its variables take more than {} MB", kMaxMatBytes >> 20)};
    if (result != Z_STREAM_END) throw Damaged{"a packed variable cannot be unpacked"};
    return out;
  }

  MatVariable matrix(Bytes data, int depth) {
    MatVariable v;
    if (data.empty()) return v;
    if (depth > kMaxDepth) throw Damaged{"its cells and structs are too deep"};
    Elements elements(data);
    const Element flags = elements.next(kUint32, "the class of a variable");
    if (flags.data.size() != 8) throw Damaged{"the class of a variable is not 8 bytes"};
    const auto word = number_at<std::uint32_t>(flags.data, 0);
    const std::uint32_t of_class = word & 0xff;
    const Element dims = elements.next(kInt32, "the size of a variable");
    const std::vector<std::int64_t> sizes = numbers_of<std::int64_t>(dims);
    if (sizes.size() < 2 || sizes[0] < 0 || sizes[1] < 0)
      throw Damaged{"the size of a variable is not two numbers from 0"};
    v.rows = static_cast<std::size_t>(sizes[0]);
    v.columns = static_cast<std::size_t>(sizes[1]);
    v.name = text_of(elements.next(kInt8, "the name of a variable").data);
    if (sizes.size() > 2 || of_class > kUint64Class || (word & kComplexFlag)) return v;  // kOther
    if (of_class >= kDoubleClass)
      take_numbers(elements.next(), of_class, v);
    else if (of_class == kCharClass)
      take_text(elements.next(), v);
    else if (of_class == kCellClass)
      take_cells(elements, v, depth);
    else if (of_class == kStructClass && v.rows == 1 && v.columns == 1)
      take_struct(elements, v, depth);
    return v;
  }

  static std::size_t count_of(const MatVariable& v, std::size_t there) {
    if (v.rows != 0 && v.columns > there / v.rows)
      throw Damaged{fmt::format("{} is {} x {}, with data of {}", v.name.substr(0, 40), v.rows,
                                v.columns, there)};
    return v.rows * v.columns;
  }
  void take_numbers(const Element& element, std::uint32_t of_class, MatVariable& v) {
    taken_ += sizeof(double) * (element.data.size() / bytes_of(element.type));
    if (taken_ > kMaxMatBytes)
      throw Damaged{fmt::format("its numbers take more than {} MB", kMaxMatBytes >> 20)};
    v.numbers = numbers_of<double>(element);
    const std::size_t count = count_of(v, v.numbers.size());
    v.numbers.resize(count);
    if (of_class == kInt64Class || of_class == kUint64Class) {
      v.wholes = numbers_of<std::int64_t>(element);
      v.wholes.resize(count);
    }
    v.kind = Kind::kNumbers;
  }
  static void take_text(const Element& element, MatVariable& v) {
    v.kind = Kind::kText;
    if (element.type == kUint8 || element.type == kUtf8 || element.type == kInt8) {
      v.text = text_of(element.data);
      return;
    }
    for (const std::int64_t c : numbers_of<std::int64_t>(element))
      v.text += c > 0 && c < 128 ? static_cast<char>(c) : '?';
  }
  void take_cells(Elements& elements, MatVariable& v, int depth) {
    v.kind = Kind::kCells;
    // Each cell has a tag of its own.
    const std::size_t count = v.rows * v.columns;
    if (v.rows != 0 && count / v.rows != v.columns) throw Damaged{"too many cells"};
    cells_ += count;
    if (cells_ > kMaxCells) throw Damaged{fmt::format("more than {} cells", kMaxCells)};
    for (std::size_t i = 0; i < count; ++i)
      v.parts.push_back(matrix(elements.next(kMatrix, "a cell").data, depth + 1));
  }
  void take_struct(Elements& elements, MatVariable& v, int depth) {
    v.kind = Kind::kStruct;
    const std::vector<std::int64_t> length =
        numbers_of<std::int64_t>(elements.next(kInt32, "the length of field names"));
    const Bytes names = elements.next(kInt8, "the names of the fields").data;
    if (length.size() != 1 || length[0] < 1 ||
        static_cast<std::size_t>(length[0]) > std::max<std::size_t>(names.size(), 1))
      throw Damaged{"the names of the fields do not fit"};
    const auto width = static_cast<std::size_t>(length[0]);
    cells_ += names.size() / width;
    if (cells_ > kMaxCells) throw Damaged{fmt::format("more than {} fields", kMaxCells)};
    for (std::size_t f = 0; (f + 1) * width <= names.size(); ++f) {
      MatVariable field = matrix(elements.next(kMatrix, "a field").data, depth + 1);
      field.name = text_of(names.subspan(f * width, width));
      field.name.resize(std::min(field.name.find('\0'), field.name.size()));
      v.parts.push_back(std::move(field));
    }
  }

  std::size_t unpacked_ = 0, taken_ = 0, cells_ = 0;
};

void collect(const MatVariable& v, const std::string& name, std::vector<MatColumn>& columns) {
  if (v.kind == Kind::kStruct)
    for (const MatVariable& field : v.parts) collect(field, name + "." + field.name, columns);
  if (v.kind != Kind::kNumbers || v.numbers.size() < 2) return;
  if (v.rows == 1 || v.columns == 1) {
    columns.push_back({name, v.numbers});
    return;
  }
  for (std::size_t c = 0; c < v.columns; ++c) {
    const auto begin = v.numbers.begin() + static_cast<std::ptrdiff_t>(c * v.rows);
    columns.push_back(
        {fmt::format("{}_{}", name, c + 1), {begin, begin + static_cast<std::ptrdiff_t>(v.rows)}});
  }
}

}  // namespace

std::vector<MatVariable> read_mat(const std::string& path) {
  static_assert(std::endian::native == std::endian::little);
  std::ifstream in(path, std::ios::binary | std::ios::ate);
  if (!in) throw BadInput(fmt::format("{}: no such file", path));
  const auto size = static_cast<std::size_t>(in.tellg());
  if (size > kMaxMatBytes)
    throw BadInput(fmt::format("{}: {} MB; a .mat of at most {} MB is read", path, size >> 20,
                               kMaxMatBytes >> 20));
  std::vector<std::uint8_t> file(size);
  in.seekg(0);
  in.read(reinterpret_cast<char*>(file.data()), static_cast<std::streamsize>(size));
  const std::string header = text_of(Bytes(file).first(std::min(size, kHeaderBytes)));
  if (header.starts_with("MATLAB 7.3") || header.starts_with("\x89HDF"))
    throw BadInput(fmt::format("{}: a file of level 7.3 (HDF5); write it with save -v7", path));
  if (size < kHeaderBytes || !header.starts_with("MATLAB 5") || header.substr(126) != "IM")
    throw BadInput(
        fmt::format("{}: not a MATLAB file of level 5, little-endian (save -v6 or -v7)", path));
  try {
    return MatReader().read(file);
  } catch (const Damaged& damage) {
    throw BadInput(fmt::format("{}: damaged MATLAB file: {}", path, damage.what));
  }
}

MatTable read_mat_table(const std::string& path) {
  std::vector<MatColumn> all;
  for (const MatVariable& v : read_mat(path)) collect(v, v.name, all);
  std::map<std::size_t, std::size_t> count;  // of the columns, by their length
  for (const MatColumn& column : all) ++count[column.values.size()];
  MatTable table;
  std::size_t most = 0;
  for (const auto& [rows, columns] : count)
    if (columns >= most) most = columns, table.rows = rows;
  for (MatColumn& column : all) {
    // A name must be one field of a header.
    const bool plain = column.name.find_first_of(",\n\r\"#") == std::string::npos;
    if (column.values.size() == table.rows && plain) table.columns.push_back(std::move(column));
  }
  if (table.columns.empty())
    throw BadInput(fmt::format("{}: no vector of two or more real numbers in the file", path));
  return table;
}

}  // namespace twinrate
