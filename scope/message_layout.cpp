#include "scope/message_layout.hpp"

#include <fmt/format.h>

#include <array>
#include <bit>
#include <sstream>
#include <stdexcept>

#include "core/field_list.hpp"
#include "scope/assets.hpp"

namespace twinrate::scope {
namespace {

std::string trimmed(const std::string& text) {
  const auto begin = text.find_first_not_of(" \t\r"), end = text.find_last_not_of(" \t\r");
  return begin == std::string::npos ? "" : text.substr(begin, end - begin + 1);
}

std::string readable_unit(const std::string& unit) {
  if (unit == "1") return "";
  if (unit == "rad_s") return "rad/s";
  if (unit == "Nm_s") return "Nm/s";
  return unit;
}

LayoutField::Type type_of(const std::string& word, const std::string& line) {
  if (word == "double") return LayoutField::Type::kDouble;
  if (word == "int32_t") return LayoutField::Type::kInt32;
  if (word == "int64_t") return LayoutField::Type::kInt64;
  if (word == "string") return LayoutField::Type::kText;
  throw std::runtime_error("a type of message that the scope cannot read: " + line);
}

int place_of(const MessageLayout& layout, const std::string& wire) {
  for (std::size_t i = 0; i < layout.fields.size(); ++i)
    if (layout.fields[i].wire == wire) return static_cast<int>(i);
  throw std::runtime_error(layout.short_name + ": no field " + wire);
}

// "double  K[n_K];             // gain"
LayoutField parse_field(const MessageLayout& layout, const std::string& line) {
  LayoutField field;
  const auto end = line.find(';');
  const std::string declaration = trimmed(line.substr(0, end));
  if (const auto slashes = line.find("//", end); slashes != std::string::npos)
    field.comment = trimmed(line.substr(slashes + 2));
  const auto space = declaration.find_first_of(" \t");
  field.type = type_of(declaration.substr(0, space), line);
  std::string name = trimmed(declaration.substr(space));
  if (const auto bracket = name.find('['); bracket != std::string::npos) {
    const std::string length = name.substr(bracket + 1, name.find(']') - bracket - 1);
    name.resize(bracket);
    field.array = true;
    if (length.find_first_not_of("0123456789") == std::string::npos)
      field.length = std::stoi(length);
    else
      field.length_field = place_of(layout, length);
  }
  const NameAndUnit split = split_unit(name);
  field.wire = name;
  field.name = split.name;
  field.unit = readable_unit(split.unit);
  // One comment can apply to several lines: "phase currents" of i_a, i_b and i_c.
  if (field.comment.empty() && !layout.fields.empty()) field.comment = layout.fields.back().comment;
  return field;
}

std::string short_name_of(Channel channel) {
  std::string name = info(channel).name;
  name = name.substr(name.find('_') + 1);
  for (char& c : name) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return name;
}

// Reads big-endian numbers one after the other; `whole` becomes false when the bytes end early.
struct Bytes {
  const std::uint8_t* at;
  std::size_t left;
  bool whole = true;

  std::uint64_t take(std::size_t count) {
    if (count > left) whole = false;
    if (!whole) return 0;
    std::uint64_t value = 0;
    for (std::size_t i = 0; i < count; ++i) value = value << 8 | at[i];
    skip(count);
    return value;
  }
  void skip(std::size_t count) {
    if (count > left) whole = false;
    const std::size_t step = whole ? count : left;
    at += step;
    left -= step;
  }
  double number(LayoutField::Type type) {
    if (type == LayoutField::Type::kDouble) return std::bit_cast<double>(take(8));
    if (type == LayoutField::Type::kInt64)
      return static_cast<double>(static_cast<std::int64_t>(take(8)));
    return static_cast<double>(static_cast<std::int32_t>(take(4)));
  }
};

}  // namespace

MessageLayout parse_layout(Channel channel, const std::string& lcm_text) {
  MessageLayout layout{.channel = channel, .short_name = short_name_of(channel)};
  std::istringstream in(lcm_text);
  bool inside = false;
  for (std::string line; std::getline(in, line);) {
    const std::string text = trimmed(line);
    if (text.starts_with("{")) inside = true;
    if (text.starts_with("}")) break;
    if (!inside || text.starts_with("//") || text.find(';') == std::string::npos) continue;
    layout.fields.push_back(parse_field(layout, text));
  }
  if (layout.fields.empty()) throw std::runtime_error(layout.short_name + ": no fields");
  return layout;
}

const MessageLayout& layout_of(Channel channel) {
  static const std::array<MessageLayout, kChannelCount> layouts = [] {
    std::array<MessageLayout, kChannelCount> all;
    for (const ChannelInfo& c : kChannels) {
      const std::string name = fmt::format("{}.lcm", c.type);
      const Asset* text = find_asset(name);
      if (!text) throw std::runtime_error(name + " is not part of this program");
      all[static_cast<std::size_t>(c.channel)] = parse_layout(c.channel, std::string(text->bytes));
    }
    return all;
  }();
  return layouts[static_cast<std::size_t>(channel)];
}

void read_numbers(const MessageLayout& layout, const std::uint8_t* bytes, std::size_t size,
                  const std::function<void(int, int, double)>& number) {
  Bytes in{bytes, size};
  in.skip(8);  // fingerprint
  std::array<std::int64_t, 64> whole_numbers{};
  for (std::size_t i = 0; i < layout.fields.size() && in.whole; ++i) {
    const LayoutField& field = layout.fields[i];
    if (field.type == LayoutField::Type::kText) {
      in.skip(in.take(4));
      continue;
    }
    const std::int64_t length = field.length_field >= 0
                                    ? whole_numbers[static_cast<std::size_t>(field.length_field)]
                                    : field.length;
    for (std::int64_t j = 0; j < length && in.whole; ++j) {
      const double value = in.number(field.type);
      if (!in.whole) return;
      if (!field.array && i < whole_numbers.size() && field.type != LayoutField::Type::kDouble)
        whole_numbers[i] = static_cast<std::int64_t>(value);
      number(static_cast<int>(i), static_cast<int>(j), value);
    }
  }
}

}  // namespace twinrate::scope
