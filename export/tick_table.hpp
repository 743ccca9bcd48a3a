// The messages of a run as one table: a drive log in canonical columns, and the fields of further
// channels as CHANNEL.field.
//
//   row k   currents, angle, speed, v_dc   MEASUREMENT(k)
//           voltage, duties                the next MEASUREMENT: applied from t_k on
//           i_d_ref, i_q_ref               COMMAND(k)
//           speed reference                REFERENCE(k), else the last one
//           T_load                         drive file in the log and requests, simulated runs only
//
// A tick is omitted if its measurement is missing or lacks a signal of the log. With voltages the
// last tick is omitted too: the voltage applied after it is unknown. The cells of a channel without
// a message at a tick are empty (NaN).
#pragma once
#include <functional>
#include <map>
#include <optional>
#include <string>

#include "core/drive_config.hpp"
#include "export/fields.hpp"
#include "trace/measured.hpp"

namespace twinrate {

class TickTable {
 public:
  // A realtime run on a busy machine had messages more than 64 ticks late. A tick is about 1 kB.
  static constexpr std::size_t kMaxLateTicks = 4096;

  // `header` is called once, before the first row.
  struct Put {
    std::function<void(const Layout&)> header;
    std::function<void(const Sample&)> row;
  };
  TickTable(std::string path, std::vector<Channel> beside, Put put);

  // True for a channel whose messages the table needs, MANIFEST included.
  bool wants(Channel channel) const;
  // Messages may be out of tick order by kMaxLateTicks; a later one is counted. Throws BadInput: another type version.
  void take(Channel channel, const void* bytes, std::size_t size);
  // Throws BadInput if a channel of `beside` is not in the log.
  void finish();
  std::int64_t left_out() const { return left_out_; }
  std::int64_t late() const { return late_; }

 private:
  struct Tick {
    std::optional<Measurement> measurement;
    std::optional<Reference> reference;
    std::optional<Command> command;
    std::map<Channel, Sample> beside;
  };
  void take_manifest(const manifest_t& manifest);
  void take_event(const event_t& event);
  bool is_beside(Channel channel) const;
  void choose_columns();
  bool may_have(const char* signal) const;  // according to the manifest of an import
  void add_columns(std::initializer_list<const char*> names, FieldKind kind);
  // Writes the first tick; false while its row is incomplete.
  bool put_first(bool at_end);
  void put_row(const Tick& tick, const Measurement* following);
  void put_canonical(const Tick& tick, const Measurement* behind, Sample& row);
  void put_beside(const Tick& tick, Channel channel, Sample& row) const;

  std::string path_;
  std::vector<Channel> beside_;
  Put put_;
  std::map<std::int64_t, Tick> ticks_;
  std::map<Channel, Layout> layouts_;
  std::optional<std::vector<std::string>> imported_;  // signals found by an import
  bool chosen_ = false;
  std::optional<int> n_p_;
  std::optional<DeclaredLoad> load_;
  double T_load_ = 0;
  std::int64_t last_k_ = -1, left_out_ = 0, late_ = 0;
  int signals_ = 0;
  bool duty_ = false, omega_m_ref_ = false, i_dq_ref_ = false, i_d_ref_ = false;
  Layout layout_;
  std::vector<double> canonical_;  // previous row: a reference keeps its value
};

}  // namespace twinrate
