// The messages of a run as the rows of one table: a drive log in the contract's canonical columns,
// and the fields of further channels beside them as CHANNEL.field.
//
//   row k: currents, angle, speed, v_dc of MEASUREMENT(k); voltage and duties of the MEASUREMENT
//   behind it, which is what was applied from t_k on; i_d_ref, i_q_ref of COMMAND(k), the speed
//   reference of REFERENCE(k), and where there is none the last one; T_load as the drive file in
//   the log declares it for a simulated run.
//
// A tick whose measurement is missing or lacks a signal that the log has is left out; the last tick
// too where there are voltages: nothing says what was applied after it. A channel that has no
// message at a tick leaves its cells empty (not a number).
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
  // `header` is called once, before the first row.
  struct Put {
    std::function<void(const Layout&)> header;
    std::function<void(const Sample&)> row;
  };
  TickTable(std::string path, std::vector<Channel> beside, Put put);

  // Channels whose messages it wants, MANIFEST among them.
  bool wants(Channel channel) const;
  // Messages may come out of tick order by a few ticks. Throws BadInput: another type version.
  void take(Channel channel, const void* bytes, std::size_t size);
  // Throws BadInput where a channel of `beside` is not in the log.
  void finish();
  std::int64_t left_out() const { return left_out_; }

 private:
  struct Tick {
    std::optional<Measurement> measurement;
    std::optional<Reference> reference;
    std::optional<Command> command;
    std::map<Channel, Sample> beside;
  };
  void take_manifest(const manifest_t& manifest);
  void choose_columns();
  bool may_have(const char* signal) const;  // by the manifest of an import
  void add_columns(std::initializer_list<const char*> names, FieldKind kind);
  // Writes the first tick; false where more has to come before.
  bool put_first(bool at_end);
  void put_row(const Tick& tick, const Measurement* following);

  std::string path_;
  std::vector<Channel> beside_;
  Put put_;
  std::map<std::int64_t, Tick> ticks_;
  std::map<Channel, Layout> layouts_;
  std::optional<std::vector<std::string>> imported_;  // signals that an import found
  bool chosen_ = false;
  std::optional<int> n_p_;
  std::optional<DeclaredLoad> load_;
  double T_load_ = 0;
  std::int64_t last_k_ = -1, left_out_ = 0;
  int signals_ = 0;
  bool duty_ = false, omega_m_ref_ = false, i_dq_ref_ = false, i_d_ref_ = false;
  Layout layout_;
  std::vector<double> canonical_;  // of the row before: what a reference still is
};

}  // namespace twinrate
