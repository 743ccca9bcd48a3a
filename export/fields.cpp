#include "export/fields.hpp"

#include <algorithm>

#include "core/decode.hpp"
#include "core/message_fields.hpp"

namespace twinrate {
namespace {

class Taker {
 public:
  Taker(Sample& sample, Layout* layout) : sample_(sample), layout_(layout) {
    sample_.numbers.clear();
    sample_.wholes.clear();
    sample_.counts.clear();
    sample_.texts.clear();
  }
  void operator()(const char* name, double value) { take(name, kind_of(name), &value, 1, false); }
  void operator()(const char* name, std::int32_t value) { whole(name, &value, 1, false); }
  void operator()(const char* name, std::int64_t value) { whole(name, &value, 1, false); }
  void operator()(const char* name, const std::string& text) {
    sample_.texts.push_back(text);
    if (layout_) layout_->texts.emplace_back(name);
  }
  void operator()(const char* name, const std::vector<double>& values, std::int32_t) {
    take(name, FieldKind::kHeld, values.data(), values.size(), true);
  }
  template <class Whole, std::size_t N>
  void operator()(const char* name, const Whole (&values)[N]) {
    whole(name, values, N, true);
  }

 private:
  static FieldKind kind_of(std::string_view name) {
    const bool starts_again = name.starts_with("theta_") && name != "theta_m_rad";
    return starts_again ? FieldKind::kAngle : FieldKind::kLinear;
  }
  template <class Whole>
  void whole(const char* name, const Whole* values, std::size_t count, bool array) {
    const std::vector<double> numbers(values, values + count);
    take(name, FieldKind::kHeld, numbers.data(), count, array, true);
    std::copy_n(values, count, sample_.wholes.end() - static_cast<std::ptrdiff_t>(count));
  }
  void take(const char* name, FieldKind kind, const double* values, std::size_t count, bool array,
            bool is_whole = false) {
    sample_.numbers.insert(sample_.numbers.end(), values, values + count);
    sample_.wholes.resize(sample_.numbers.size());
    sample_.counts.push_back(count);
    if (layout_) layout_->numbers.push_back({name, kind, array, count, is_whole});
  }

  Sample& sample_;
  Layout* layout_;
};

template <class Message>
bool read(const void* bytes, std::size_t size, Sample& sample, Layout* layout) {
  Message message{};
  if (!decode(message, bytes, size)) return false;
  sample.k = message.seq;
  sample.t_ns = message.t_ns;
  sample.origin = {.session = message.session, .tag = message.tag};
  Taker taker(sample, layout);
  each_field(message, taker);
  return true;
}

}  // namespace

bool read_sample(Channel channel, const void* bytes, std::size_t size, Sample& sample,
                 Layout* layout) {
  if (layout) *layout = {};
  switch (channel) {
    case Channel::kMeasurement:
      return read<measurement_t>(bytes, size, sample, layout);
    case Channel::kTruth:
      return read<truth_t>(bytes, size, sample, layout);
    case Channel::kEstimate:
      return read<estimate_t>(bytes, size, sample, layout);
    case Channel::kGain:
      return read<gain_t>(bytes, size, sample, layout);
    case Channel::kReference:
      return read<reference_t>(bytes, size, sample, layout);
    case Channel::kCommand:
      return read<command_t>(bytes, size, sample, layout);
    case Channel::kStatus:
      return read<status_t>(bytes, size, sample, layout);
    case Channel::kEvent:
      return read<event_t>(bytes, size, sample, layout);
    case Channel::kManifest:
      return read<manifest_t>(bytes, size, sample, layout);
    case Channel::kRequest:
      return read<request_t>(bytes, size, sample, layout);
    case Channel::kReply:
      return read<reply_t>(bytes, size, sample, layout);
    case Channel::kAck:
      return read<ack_t>(bytes, size, sample, layout);
  }
  return false;
}

}  // namespace twinrate
