// The host's side of the twinrate protocol (firmware/protocol, docs/bridge-protocol.md).
//
// Frames are put in order by their sequence number: a gap counts as lost, the same number again as
// doubled, an older one as late (and no longer as lost). A step back by more than kReorder ticks, or
// kOldInARow old frames in a row, is a restart of the drive: its ticks begin at 0, and those of the
// samples given here go on by one, each once.
#pragma once
#include <array>
#include <deque>

#include "bridge/host_protocol.hpp"
#include "firmware/protocol/twinrate_protocol.h"

namespace twinrate {

// A drive that accepts only duties gets a voltage vector as duties, by the bus voltage of its last
// sample.
class TwinrateHost final : public HostProtocol {
 public:
  static constexpr std::int32_t kReorder = 32;
  static constexpr int kOldInARow = 8;

  // `delay`: plant.delay_samples. COMMAND(k) is due at the drive by tick k + delay. `first_seq`: the
  // number that the frames of this host follow; a random one separates the answers to it from those to
  // an earlier host that are still on the line.
  explicit TwinrateHost(bool float64, int delay = 1, std::uint32_t first_seq = 0)
      : float64_(float64),
        due_ticks_(delay > 1 ? delay : 1),
        sent_(first_seq),
        first_question_(first_seq + 1) {}

  void take(std::span<const std::uint8_t> bytes, std::int64_t arrival_ns) override;
  std::optional<DriveSample> next() override;
  Bytes hello(bool lockstep) override;
  Bytes command(const DriveCommand& command) override;
  Bytes off() override;
  Bytes clear(int reason) override;
  void forget_info() override;

 private:
  void take_info(const twp_frame& f);
  void take_sample(const twp_frame& f, std::int64_t arrival_ns);
  bool in_order(std::uint32_t seq);
  void note_answer(std::uint32_t command_seq);
  Bytes written(twp_frame& f);

  static constexpr std::size_t kRemembered = 1024;

  bool float64_;
  int due_ticks_;
  std::array<std::int64_t, kRemembered>
      sample_of_{};  // of a command, by its seq; -1: it enables not
  std::uint32_t first_command_ = 0;
  twp_receiver receiver_{};
  std::deque<DriveSample> samples_;
  bool begun_ = false;
  std::uint32_t sent_, first_question_;  // INFO answers one from first_question_ to sent_
  std::uint32_t last_seq_ = 0, last_time_us_ = 0;
  bool lockstep_ = false;                  // requested
  std::int64_t k_ = 0, restarted_at_ = 0;  // tick of the last sample; that of tick 0 of the drive
  int old_in_a_row_ = 0;
  double v_dc_ = 0;  // of the last sample
};

}  // namespace twinrate
