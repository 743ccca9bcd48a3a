#include "tests/fuzz/inputs.hpp"

#include <sys/mman.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>

#include "core/bus_parameters.hpp"
#include "core/decode.hpp"
#include "core/logger_parameters.hpp"
#include "core/message_check.hpp"
#include "core/run_log.hpp"
#include "core/signals_io.hpp"
#include "import/drive_rows.hpp"
#include "import/map.hpp"
#include "tests/support/damaged_log.hpp"

namespace twinrate::fuzz {
namespace {

// Ends the program at the input that shows it.
void require(bool holds, const char* claim) {
  if (holds) return;
  std::fprintf(stderr, "does not hold: %s\n", claim);
  std::abort();
}

Bytes bytes_of(const std::string& text) {
  return {text.begin(), text.end()};
}

// A file in memory, with a name.
class MemoryFile {
 public:
  MemoryFile(const std::uint8_t* bytes, std::size_t size) : fd_(memfd_create("fuzz", 0)) {
    require(fd_ >= 0 && write(fd_, bytes, size) == static_cast<ssize_t>(size), "a file in memory");
  }
  ~MemoryFile() { close(fd_); }
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;
  std::string path() const { return "/proc/self/fd/" + std::to_string(fd_); }

 private:
  int fd_;
};

template <class Wire>
void use_signal(const std::uint8_t* bytes, std::size_t size) {
  Wire wire{};
  if (decode(wire, bytes, size)) (void)from_wire(wire);
}

void use_estimate(const std::uint8_t* bytes, std::size_t size) {
  estimate_t wire{};
  if (!decode(wire, bytes, size)) return;
  const Estimate e = from_wire(wire);
  require(e.n_x >= 0 && e.n_x <= kMaxStates && e.n_y >= 0 && e.n_y <= kMaxOutputs, "sizes fit");
  (void)estimate_status(bytes, size);
}

void use_gain(const std::uint8_t* bytes, std::size_t size) {
  gain_t wire{};
  if (!decode(wire, bytes, size)) return;
  const Gain g = from_wire(wire);
  require(g.n_x >= 0 && g.n_x <= kMaxStates && g.n_y >= 0 && g.n_y <= kMaxOutputs, "sizes fit");
  require(g.n_speeds >= 0 && g.n_speeds <= kMaxSpeeds, "speeds fit");
  const GainRecord record(g);
  (void)record.P_diagonal(kMaxStates - 1);
}

void use(Channel channel, const std::uint8_t* bytes, std::size_t size) {
  switch (channel) {
    case Channel::kMeasurement:
      return use_signal<measurement_t>(bytes, size);
    case Channel::kTruth:
      return use_signal<truth_t>(bytes, size);
    case Channel::kReference:
      return use_signal<reference_t>(bytes, size);
    case Channel::kCommand:
      return use_signal<command_t>(bytes, size);
    case Channel::kEstimate:
      return use_estimate(bytes, size);
    case Channel::kGain:
      return use_gain(bytes, size);
    default:
      return;
  }
}

constexpr const char* kDrive =
    "name = \"fuzz\"\nstart = \"flying\"\n[machine]\nR_s_Ohm = 1.2\nL_d_H = 0.5e-3\nL_q_H = "
    "0.5e-3\n"
    "psi_f_Wb = 0.007\nn_p = 4\nJ_kgm2 = 1e-5\nB_Nms = 1e-5\n[inverter]\nv_dc_V = "
    "24.0\n[rates]\nf_s_Hz = 5000\n"
    "n = 5\n[controller.foc]\ni_max_A = 3\n[reference]\nomega_e_rad_s = [[0, 400], [1, -200]]\n"
    "[load]\nT_load_Nm = 0.01\n[[effect]]\nkind = \"cogging\"\norder = 24\namplitude_Nm = 1e-3\n";
constexpr const char* kEffect =
    "[[effect]]\nkind = \"coulomb_friction\"\ntorque_Nm = 0.002\nused_in = \"model\"\n";

template <class Wire>
void add(std::vector<Bytes>& seeds, Wire wire) {
  Bytes bytes(1 + static_cast<std::size_t>(wire.getEncodedSize()));
  bytes[0] = static_cast<std::uint8_t>(kChannelOf<Wire>);
  wire.encode(bytes.data() + 1, 0, static_cast<int>(bytes.size()) - 1);
  seeds.push_back(bytes);
}

std::vector<Bytes> message_seeds() {
  std::vector<Bytes> seeds;
  add(seeds, to_wire(Measurement{.k = 3, .t_ns = 600000, .signals = 15}, 7));
  add(seeds, to_wire(Truth{.k = 3}, 7));
  add(seeds, to_wire(Estimate{.k = 3, .n_x = 4, .n_y = 2}, 7));
  add(seeds, to_wire(Gain{.k = 3, .n_x = 4, .n_y = 2, .n_speeds = 2}, 7));
  add(seeds, to_wire(Reference{.k = 3}, 7));
  add(seeds, to_wire(Command{.k = 3}, 7));
  add(seeds, status_t{});
  event_t event{};
  event.text = "a text";
  add(seeds, event);
  request_t request{};
  request.kind = 4;
  request.text = kEffect;
  add(seeds, request);
  reply_t reply{};
  reply.text = "done";
  add(seeds, reply);
  add(seeds, make_manifest(1, kDrive, "{}"));
  add(seeds, ack_t{});
  return seeds;
}

std::vector<Bytes> log_seeds() {
  const Config config = Config::parse(kDrive, "seed");
  return {bytes_of(test::file_of(test::small_log(config, 3)))};
}

std::vector<Bytes> csv_seeds() {
  std::string text = "t,i_d,i_q,u_d,u_q,theta_m,omega_m\n# a comment\n";
  for (int row = 0; row < 210; ++row)
    text +=
        std::to_string(row * 1e-3) + ",0.1,1.5,-0.2,3.1," + std::to_string(row * 0.1) + ",100\n";
  return {bytes_of(text), bytes_of("i_d;i_q;psi_d;psi_q\n0,1;0,2;0,007;0\n")};
}

}  // namespace

void message(const std::uint8_t* bytes, std::size_t size) {
  if (size < 1) return;
  const auto channel = static_cast<Channel>(bytes[0] % kChannelCount);
  std::int64_t seq = 0, t_ns = 0;
  const bool whole = is_whole_message(channel, bytes + 1, size - 1, seq, t_ns);
  require(!whole || has_fingerprint_of(channel, bytes + 1, size - 1), "whole has its fingerprint");
  use(channel, bytes + 1, size - 1);  // also what the check refuses: a reader may skip it
}

void request(const std::uint8_t* bytes, std::size_t size) {
  static const Config config = Config::parse(kDrive, "fuzz");
  const std::string text(reinterpret_cast<const char*>(bytes), size);
  try {
    const Config more = config.with_effects(text, "request");
    // What was added can be taken out, and no more than that.
    const Config less = more.without_effects(text, "request", config.drive().effects.size());
    require(less.drive().effects.size() == config.drive().effects.size(), "as many as before");
  } catch (const BadInput&) {
  }
}

void log_file(const std::uint8_t* bytes, std::size_t size) {
  const MemoryFile file(bytes, size);
  for (const OnDamage on_damage : {OnDamage::kRefuse, OnDamage::kSkip}) try {
      const RunLog log = read_run_log(file.path(), "", on_damage);
      require(log.measurement.size() <= size && log.events.size() <= size,
              "no more than its bytes");
      require(on_damage == OnDamage::kSkip || log.damage.empty(), "damage is refused");
    } catch (const BadInput&) {
    }
}

void drive_file(const std::uint8_t* bytes, std::size_t size) {
  const std::string text(reinterpret_cast<const char*>(bytes), size);
  try {
    Config config = Config::parse(text, "fuzz");
    (void)config.read<BusParameters>();
    (void)config.read<LoggerParameters>();
    // The resolved file is the same drive.
    const std::string resolved = config.resolved();
    Config again = Config::parse(resolved, "resolved");
    (void)again.read<BusParameters>();
    (void)again.read<LoggerParameters>();
    require(again.resolved() == resolved, "the resolved file resolves to itself");
  } catch (const BadInput&) {
  }
}

void csv_file(const std::uint8_t* bytes, std::size_t size) {
  const MemoryFile file(bytes, size);
  for (const bool repair : {false, true}) try {
      const DriveRows rows = holds_time(file.path(), nullptr)
                                 ? read_drive_rows(file.path(), nullptr, repair)
                                 : read_static_rows(file.path(), nullptr, repair);
      for (const auto& [name, column] : rows.columns)
        require(column.size() == rows.size(), "columns of one length");
      for (std::size_t i = 1; i < rows.t.size(); ++i)
        require(rows.t[i] > rows.t[i - 1], "time rises");
    } catch (const BadInput&) {
    }
}

const std::vector<Reader> kReaders = {
    {"message", message, message_seeds},
    {"request", request, [] { return std::vector<Bytes>{bytes_of(kEffect)}; }},
    {"log", log_file, log_seeds},
    {"drive_file", drive_file, [] { return std::vector<Bytes>{bytes_of(kDrive)}; }},
    {"csv", csv_file, csv_seeds},
};

}  // namespace twinrate::fuzz
