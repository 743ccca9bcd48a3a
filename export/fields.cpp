#include "export/fields.hpp"

#include "core/decode.hpp"

namespace twinrate {
namespace {

class Taker {
 public:
  Taker(Sample& sample, Layout* layout) : sample_(sample), layout_(layout) {
    sample_.numbers.clear();
    sample_.counts.clear();
    sample_.texts.clear();
  }
  void operator()(const char* name, double value) { take(name, kind_of(name), &value, 1, false); }
  void operator()(const char* name, std::int32_t value) { whole(name, value); }
  void operator()(const char* name, std::int64_t value) { whole(name, value); }
  void operator()(const char* name, const std::string& text) {
    sample_.texts.push_back(text);
    if (layout_) layout_->texts.emplace_back(name);
  }
  void operator()(const char* name, const std::vector<double>& values) {
    take(name, FieldKind::kHeld, values.data(), values.size(), true);
  }
  template <class Whole, std::size_t N>
  void operator()(const char* name, const Whole (&values)[N]) {
    const std::vector<double> numbers(values, values + N);
    take(name, FieldKind::kHeld, numbers.data(), N, true);
  }

 private:
  static FieldKind kind_of(std::string_view name) {
    const bool starts_again = name.starts_with("theta_") && name != "theta_m_rad";
    return starts_again ? FieldKind::kAngle : FieldKind::kLinear;
  }
  template <class Whole>
  void whole(const char* name, Whole value) {
    const auto number = static_cast<double>(value);
    take(name, FieldKind::kHeld, &number, 1, false);
  }
  void take(const char* name, FieldKind kind, const double* values, std::size_t count, bool array) {
    sample_.numbers.insert(sample_.numbers.end(), values, values + count);
    sample_.counts.push_back(count);
    if (layout_) layout_->numbers.push_back({name, kind, array, count});
  }

  Sample& sample_;
  Layout* layout_;
};

#define TWINRATE_FIELD(name) f(#name, m.name)

void fields(const measurement_t& m, Taker& f) {
  TWINRATE_FIELD(signals);
  TWINRATE_FIELD(i_a_A);
  TWINRATE_FIELD(i_b_A);
  TWINRATE_FIELD(i_c_A);
  TWINRATE_FIELD(u_alpha_V);
  TWINRATE_FIELD(u_beta_V);
  TWINRATE_FIELD(duty_a);
  TWINRATE_FIELD(duty_b);
  TWINRATE_FIELD(duty_c);
  TWINRATE_FIELD(mode);
  TWINRATE_FIELD(theta_forced_rad);
  TWINRATE_FIELD(v_dc_V);
  TWINRATE_FIELD(theta_m_rad);
  TWINRATE_FIELD(omega_m_rad_s);
}
void fields(const truth_t& m, Taker& f) {
  TWINRATE_FIELD(i_d_A);
  TWINRATE_FIELD(i_q_A);
  TWINRATE_FIELD(omega_m_rad_s);
  TWINRATE_FIELD(theta_m_rad);
  TWINRATE_FIELD(T_em_Nm);
  TWINRATE_FIELD(T_load_Nm);
}
void fields(const estimate_t& m, Taker& f) {
  TWINRATE_FIELD(gain_seq);
  TWINRATE_FIELD(status);
  TWINRATE_FIELD(n_x);
  TWINRATE_FIELD(n_y);
  TWINRATE_FIELD(theta_e_rad);
  TWINRATE_FIELD(omega_m_rad_s);
  TWINRATE_FIELD(i_d_A);
  TWINRATE_FIELD(i_q_A);
  TWINRATE_FIELD(T_load_Nm);
  TWINRATE_FIELD(dT_load_Nm_s);
  TWINRATE_FIELD(x_hat);
  TWINRATE_FIELD(innov);
}
void fields(const gain_t& m, Taker& f) {
  TWINRATE_FIELD(first_use_seq);
  TWINRATE_FIELD(n_x);
  TWINRATE_FIELD(n_y);
  TWINRATE_FIELD(theta_e_rad);
  TWINRATE_FIELD(n_K);
  TWINRATE_FIELD(K);
  TWINRATE_FIELD(n_P);
  TWINRATE_FIELD(P);
  TWINRATE_FIELD(n_speeds);
  TWINRATE_FIELD(at_omega_m_rad_s);
  TWINRATE_FIELD(n_K_at);
  TWINRATE_FIELD(K_at);
}
void fields(const reference_t& m, Taker& f) {
  TWINRATE_FIELD(omega_m_ref_rad_s);
  TWINRATE_FIELD(i_d_ref_A);
}
void fields(const command_t& m, Taker& f) {
  TWINRATE_FIELD(mode);
  TWINRATE_FIELD(u_alpha_V);
  TWINRATE_FIELD(u_beta_V);
  TWINRATE_FIELD(i_d_ref_A);
  TWINRATE_FIELD(i_q_ref_A);
  TWINRATE_FIELD(i_d_A);
  TWINRATE_FIELD(i_q_A);
  TWINRATE_FIELD(theta_ctrl_rad);
  TWINRATE_FIELD(omega_m_ref_rad_s);
}
void fields(const status_t& m, Taker& f) {
  TWINRATE_FIELD(config_hash);
  TWINRATE_FIELD(role);
  TWINRATE_FIELD(state);
  TWINRATE_FIELD(steps);
  TWINRATE_FIELD(repeats);
  TWINRATE_FIELD(duplicates);
  TWINRATE_FIELD(gaps);
  TWINRATE_FIELD(refused);
  TWINRATE_FIELD(undecodable);
  TWINRATE_FIELD(late_commands);
  TWINRATE_FIELD(late_gains);
  TWINRATE_FIELD(deadline_misses);
}
void fields(const event_t& m, Taker& f) {
  TWINRATE_FIELD(role);
  TWINRATE_FIELD(reason);
  TWINRATE_FIELD(waited_for);
  TWINRATE_FIELD(text);
}
void fields(const manifest_t& m, Taker& f) {
  TWINRATE_FIELD(schema);
  TWINRATE_FIELD(revision);
  TWINRATE_FIELD(config_toml);
  TWINRATE_FIELD(manifest_json);
}
void fields(const request_t& m, Taker& f) {
  TWINRATE_FIELD(kind);
  TWINRATE_FIELD(value);
  TWINRATE_FIELD(text);
}
void fields(const reply_t& m, Taker& f) {
  TWINRATE_FIELD(role);
  TWINRATE_FIELD(accepted);
  TWINRATE_FIELD(applied_seq);
  TWINRATE_FIELD(text);
}
void fields(const ack_t& m, Taker& f) {
  TWINRATE_FIELD(n_missing);
  TWINRATE_FIELD(missing_channel);
  TWINRATE_FIELD(missing_seq);
}

#undef TWINRATE_FIELD

template <class Message>
bool read(const void* bytes, std::size_t size, Sample& sample, Layout* layout) {
  Message message{};
  if (!decode(message, bytes, size)) return false;
  sample.k = message.seq;
  sample.t_ns = message.t_ns;
  Taker taker(sample, layout);
  fields(message, taker);
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
