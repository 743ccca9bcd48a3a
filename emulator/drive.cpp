#include "emulator/drive.hpp"

#include "import/drive_messages.hpp"
#include "import/drive_rows.hpp"
#include "import/map.hpp"

namespace twinrate {

PlantDrive::PlantDrive(Config& config)
    : plant_(config), delay_(config.drive().plant.delay_samples) {}

void PlantDrive::switch_off(Reason reason) {
  off_ = true;
  if (latched_ == Reason::kNone) latched_ = reason;
}

// The plant gets a command at every tick while one is in force. The lease of the device limits that
// time, not the plant.
void PlantDrive::advance(const Command* command) {
  const std::int64_t due = plant_.k() - delay_;
  const bool off = off_ || latched_ != Reason::kNone;
  if (due >= 0 && (command || off)) {
    Command now = off ? Command{.mode = Mode::kSafe} : *command;
    now.k = due;
    plant_.take_command(now);
  }
  plant_.advance();
  for (int i = 0; i < plant_.safety().event_count(); ++i) {
    const SafetyEvent& event = plant_.safety().event(i);
    if (event.to == DriveState::kSafe && event.reason != Reason::kSafeRequested)
      latched_ = event.reason;
  }
  // Safe mode on request of the host is not latched: the next command ends it.
  if (latched_ == Reason::kNone && (off_ || plant_.tripped())) {
    plant_.reset();
    off_ = false;
  }
}

bool PlantDrive::clear() {
  const bool cleared = !plant_.tripped() || plant_.reset().empty();
  if (cleared) latched_ = Reason::kNone, off_ = false;
  return cleared;
}

RecordedDrive::RecordedDrive(const std::string& path, const std::string& map,
                             const DriveConfig& drive) {
  const ImportMap columns = map.empty() ? ImportMap{} : read_import_map(map);
  const DriveRows rows = read_drive_rows(path, map.empty() ? nullptr : &columns, false);
  const TickGrid grid = place_on_grid(rows, drive.rates.f_s_Hz);
  const DriveMessages messages(rows, drive.machine.n_p, drive.inverter.v_dc);
  for (const TickGrid::Slot& slot : grid.slots) rows_.push_back(messages.measurement(slot));
}

const Measurement* RecordedDrive::sample() const {
  return !ended() && rows_[next_].k == k_ ? &rows_[next_] : nullptr;
}

void RecordedDrive::advance(const Command*) {
  if (sample()) ++next_;
  ++k_;
}

}  // namespace twinrate
