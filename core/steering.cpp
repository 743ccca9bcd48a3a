#include "core/steering.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <set>

#include "core/reason.hpp"
#include "core/run_log.hpp"
#include "core/steering_limits.hpp"

namespace twinrate {
namespace {

constexpr double kRampStep_s = 0.01;
constexpr int kRampStepsMax = 200;
constexpr int kNMax = 100000;  // as rates.n
constexpr const char* kKeys =
    "speed_rpm, omega_e_rad_s, load_Nm, n, policy, compensation, start, stop";

[[noreturn]] void refuse(std::string_view key, std::string_view value, const std::string& allowed) {
  throw BadInput(fmt::format("{}={}: {} allowed", key, value, allowed));
}

std::size_t position(std::string_view key, std::string_view value,
                     std::span<const char* const> names) {
  const auto found = std::find(names.begin(), names.end(), value);
  if (found == names.end())
    refuse(key, value, fmt::format("one of {}", fmt::join(names.begin(), names.end(), ", ")));
  return static_cast<std::size_t>(found - names.begin());
}

// The first tick of a step; exact multiples of a period may lie a rounding beside it.
std::int64_t tick_of(double t_s, double f_s) {
  return static_cast<std::int64_t>(std::ceil(t_s * f_s - 1e-6));
}

// A steady load that the drive is made for.
double largest_load(const DriveConfig& d) {
  double load = std::max(d.machine.T_rated, d.machine.torque_constant() * d.machine.i_rated);
  for (const ProfileStep& step : d.load.T_load_Nm.steps())
    load = std::max(load, std::abs(step.value));
  return load;
}

template <class Name>
std::string list_text(const Profile& profile, const Name& name) {
  std::string text;
  for (const ProfileStep& step : profile.steps())
    text += fmt::format("{}[{}, {}]", text.empty() ? "" : ", ", step.t_s, name(step.value));
  return "[" + text + "]";
}
std::string list_text(const Profile& profile) {
  return list_text(profile, [](double value) { return fmt::format("{}", value); });
}

std::vector<double> values_from(const Profile& profile, double t_s) {
  std::vector<double> values = {profile.at(t_s)};
  for (const ProfileStep& step : profile.steps())
    if (step.t_s > t_s) values.push_back(step.value);
  return values;
}

bool sets_the_speed(std::string_view key) {
  return key == "start" || key == "stop" || key == "speed_rpm" || key == "omega_e_rad_s";
}

std::vector<std::string_view> lines_of(std::string_view text) {
  std::vector<std::string_view> lines;
  while (!text.empty()) {
    const auto end = std::min(text.find('\n'), text.size());
    if (end > 0) lines.push_back(text.substr(0, end));
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return lines;
}

}  // namespace

void SteeringParameters::fields(FieldVisitor& f) {
  f.number("hold_s", hold_s, 0, 3600,
           "time for which the drive holds after the last heartbeat of the holder of the control; "
           "then it stops");
  f.number("ramp_rad_s2", ramp_rad_s2, 1e-3, 1e9,
           "slope of the speed reference at start and stop, electrical");
  f.number("load_max_Nm", load_max, 0, 1e6,
           "largest load that a request can ask for; 0: the largest of rated torque, torque of the "
           "rated current and loads of the file");
  f.profile("n", n, 0, kNMax, "changes of rates.n while the drive runs; 0: rates.n");
  f.choice_profile("policy", policy, kSteeredPolicyNames,
                   "changes of gain.policy while the drive runs");
  f.choice_profile("emergency", emergency, kEmergencyNames,
                   "emergency stops, and resets from SAFE to IDLE, each at its time");
}

SteeringParameters steering_of(Config& config) {
  const auto steering = config.read<SteeringParameters>();
  for (const ProfileStep& step : steering.n.steps())
    if (step.value != std::floor(step.value))
      throw BadInput(fmt::format("{}: steering.n: whole numbers allowed, found {}",
                                 config.where("steering.n"), step.value));
  const double f_s_Hz = config.drive().rates.f_s_Hz;
  for (const auto& [key, profile, instead] :
       {std::tuple("steering.n", &steering.n, "rates.n"),
        std::tuple("steering.policy", &steering.policy, "gain.policy")})
    for (const ProfileStep& step : profile->steps())
      if (step.value != 0 && tick_of(step.t_s, f_s_Hz) <= 0)
        throw BadInput(fmt::format(
            "{}: {}: changes after 0 s allowed, [[t_s, value], ..]; from the start on it is {}",
            config.where(key), key, instead));
  return steering;
}

std::vector<PlannedEmergency> planned_emergencies(const DriveConfig& drive,
                                                  const SteeringParameters& steering) {
  std::vector<PlannedEmergency> list;
  for (const ProfileStep& step : steering.emergency.steps())
    if (step.value != 0)
      list.push_back({std::max<std::int64_t>(0, tick_of(step.t_s, drive.rates.f_s_Hz)),
                      kEmergencyNames[static_cast<int>(step.value)] == std::string("reset")});
  return list;
}

std::vector<std::int64_t> planned_resets(Config& config) {
  std::vector<std::int64_t> ticks;
  for (const PlannedEmergency& e : planned_emergencies(config.drive(), steering_of(config)))
    if (e.reset) ticks.push_back(e.k);
  return ticks;
}

RateHistory rate_history(const DriveConfig& drive, const SteeringParameters& steering) {
  std::set<std::int64_t> ticks;
  for (const Profile* profile : {&steering.n, &steering.policy})
    for (const ProfileStep& step : profile->steps())
      if (const std::int64_t k = tick_of(step.t_s, drive.rates.f_s_Hz); k > 0) ticks.insert(k);
  std::vector<RateChange> changes;
  RateChange last{.k = 0, .n = drive.rates.n, .policy = drive.gain.policy};
  for (const std::int64_t k : ticks) {
    const double t_s = (static_cast<double>(k) + 0.25) * drive.T_s();
    const int n = static_cast<int>(steering.n.at(t_s)),
              policy = static_cast<int>(steering.policy.at(t_s));
    RateChange change{
        .k = k,
        .n = n > 0 ? n : drive.rates.n,
        .policy = policy > 0 ? static_cast<GainPolicy>(policy - 1) : drive.gain.policy};
    if (change.n == last.n && change.policy == last.policy) continue;
    changes.push_back(last = change);
  }
  return {drive.gain.policy, drive.background_rate(), std::move(changes)};
}

double steered_number(std::string_view key, std::string_view value) {
  double number = 0;
  const auto [end, error] = std::from_chars(value.data(), value.data() + value.size(), number);
  if (error != std::errc() || end != value.data() + value.size() || !std::isfinite(number))
    refuse(key, value, "a number");
  return number;
}

std::optional<double> steered_load(std::string_view lines) {
  constexpr std::string_view kLoad = "load_Nm=";
  for (const std::string_view line : lines_of(lines))
    if (line.starts_with(kLoad)) return steered_number("load_Nm", line.substr(kLoad.size()));
  return {};
}

SteeringLimits steering_limits(const DriveConfig& drive, const SteeringParameters& steering) {
  return {.omega_m = 0.5 * drive.omega_m_limit(),
          .load = steering.load_max > 0 ? steering.load_max : largest_load(drive)};
}

SteeredDrive::SteeredDrive(Config& config)
    : drive_(config.drive()),
      steering_(steering_of(config)),
      omega_m_max_(steering_limits(drive_, steering_).omega_m),
      load_max_(steering_limits(drive_, steering_).load) {}

Profile& SteeredDrive::speed() {
  return drive_.reference.in_rpm ? drive_.reference.speed_rpm : drive_.reference.omega_e_rad_s;
}

double SteeredDrive::speed_factor() const {
  return drive_.reference.in_rpm ? 60 / (kTwoPi * drive_.machine.n_p) : 1;
}

void SteeredDrive::add_step(Profile& profile, std::int64_t k, double value) const {
  std::vector<ProfileStep> steps = profile.steps();
  const ProfileStep first = steps.front();
  std::erase_if(steps, [&](const ProfileStep& step) { return step.t_s >= t_of(k); });
  if (steps.empty()) steps.push_back({0, first.value});
  steps.push_back({t_of(k), value});
  profile = Profile(std::move(steps));
}

void SteeredDrive::set_speed(double omega_e, std::string_view key, std::string_view value,
                             std::int64_t k) {
  const double factor = key == "speed_rpm" ? 60 / (kTwoPi * drive_.machine.n_p) : 1;
  // Compared as DriveConfig::omega_m_limit computes it, which must not grow.
  const double as_written = omega_e * speed_factor();
  const double omega_m = drive_.reference.in_rpm ? std::abs(as_written) * kTwoPi / 60
                                                 : std::abs(as_written) / drive_.machine.n_p;
  if (omega_m > omega_m_max_)
    refuse(key, value,
           fmt::format("{:.6g} to {:.6g} (the fastest of machine.omega_m_rated_rad_s and the "
                       "references of the drive file)",
                       -omega_m_max_ * drive_.machine.n_p * factor,
                       omega_m_max_ * drive_.machine.n_p * factor));
  add_step(speed(), k, as_written);
  stopped_from_.reset();
}

void SteeredDrive::set_load(std::string_view value, std::int64_t k) {
  const double load = steered_number("load_Nm", value);
  if (std::abs(load) > load_max_)
    refuse("load_Nm", value, fmt::format("{:.6g} to {:.6g}", -load_max_, load_max_));
  add_step(drive_.load.T_load_Nm, k, load);
}

void SteeredDrive::ramp(double to, std::int64_t k) {
  const double from = speed().at(static_cast<double>(k) * drive_.T_s()) / speed_factor();
  const double step_s =
      std::max(kRampStep_s, std::abs(to - from) / (steering_.ramp_rad_s2 * kRampStepsMax));
  const auto ticks = std::max<std::int64_t>(1, std::llround(step_s * drive_.rates.f_s_Hz));
  const double step = steering_.ramp_rad_s2 * static_cast<double>(ticks) * drive_.T_s();
  const auto count = static_cast<std::int64_t>(std::ceil(std::abs(to - from) / step));
  for (std::int64_t i = 1; i <= count; ++i)
    add_step(speed(), k + (i - 1) * ticks,
             speed_factor() *
                 (i == count ? to : from + (to > from ? 1 : -1) * static_cast<double>(i) * step));
  if (count == 0) add_step(speed(), k, to * speed_factor());
}

void SteeredDrive::stop(std::int64_t k) {
  const double now = speed().at(static_cast<double>(k) * drive_.T_s()) / speed_factor();
  if (!stopped_from_) stopped_from_ = now;
  ramp(0, k);
}

void SteeredDrive::start(std::int64_t k) {
  if (!stopped_from_) throw BadInput("start: the drive was not stopped");
  ramp(*stopped_from_, k);
  stopped_from_.reset();
}

void SteeredDrive::set(std::string_view key, std::string_view value, std::int64_t k) {
  if (key == "speed_rpm")
    return set_speed(steered_number(key, value) * kTwoPi / 60 * drive_.machine.n_p, key, value, k);
  if (key == "omega_e_rad_s") return set_speed(steered_number(key, value), key, value, k);
  if (key == "load_Nm") return set_load(value, k);
  if (key == "policy")
    return add_step(steering_.policy, k,
                    static_cast<double>(position(key, value, kGainPolicyNames) + 1));
  if (key == "compensation")
    return add_step(drive_.controller.compensation, k,
                    static_cast<double>(position(key, value, kCompensationNames)));
  if (key != "n") throw BadInput(fmt::format("{}: one of {} allowed", key, kKeys));
  const double n = steered_number(key, value);
  if (n < 1 || n > kNMax || n != std::floor(n))
    refuse(key, value, fmt::format("a whole number from 1 to {}", kNMax));
  add_step(steering_.n, k, n);
}

void SteeredDrive::apply(std::string_view text, std::int64_t k) {
  SteeredDrive changed = *this;
  const std::vector<std::string_view> lines = lines_of(text);
  if (lines.empty()) throw BadInput(fmt::format("nothing to set: KEY=VALUE, {} allowed", kKeys));
  std::set<std::string_view> seen;
  for (const std::string_view line : lines) {
    const auto equals = line.find('=');
    const std::string_view key = line.substr(0, equals);
    const bool moves = sets_the_speed(key);
    if (moves && drive_.reference.from_bus)
      throw BadInput(fmt::format(
          "{}: the speed reference comes from another process (reference.from_bus)", key));
    if (!seen.insert(moves ? "speed" : key).second)
      throw BadInput(fmt::format("{}: once in a request allowed", key));
    if (equals == std::string_view::npos && key == "stop")
      changed.stop(k);
    else if (equals == std::string_view::npos && key == "start")
      changed.start(k);
    else if (equals == std::string_view::npos || key == "stop" || key == "start")
      throw BadInput(fmt::format("{}: KEY=VALUE, start or stop allowed", line));
    else
      changed.set(key, line.substr(equals + 1), k);
  }
  *this = std::move(changed);
}

void SteeredDrive::forget_before(std::int64_t k) {
  for (Profile* profile : {&drive_.reference.speed_rpm, &drive_.reference.omega_e_rad_s,
                           &drive_.load.T_load_Nm, &drive_.controller.compensation}) {
    std::vector<ProfileStep> steps = profile->steps();
    const auto later = std::find_if(steps.begin(), steps.end(), [&](const ProfileStep& step) {
      return step.t_s > static_cast<double>(k) * drive_.T_s();
    });
    if (later - steps.begin() < 2) continue;
    steps.erase(steps.begin(), later - 1);
    *profile = Profile(std::move(steps));
  }
}

std::vector<GainPolicy> SteeredDrive::policies_from(std::int64_t k) const {
  std::vector<GainPolicy> policies;
  const RateHistory history = rates();
  policies.push_back(history.policy_at(k));
  for (const RateChange& change : history.changes())
    if (change.k > k) policies.push_back(change.policy);
  return policies;
}

std::vector<Compensation> SteeredDrive::compensations_from(std::int64_t k) const {
  std::vector<Compensation> list;
  for (const double value :
       values_from(drive_.controller.compensation, static_cast<double>(k) * drive_.T_s()))
    list.push_back(static_cast<Compensation>(static_cast<int>(value)));
  return list;
}

std::vector<std::string> SteeredDrive::overrides() const {
  const auto names = [](const auto& table) {
    return [&table](double index) {
      return fmt::format("\"{}\"", table[static_cast<std::size_t>(index)]);
    };
  };
  const bool rpm = drive_.reference.in_rpm;
  return {fmt::format("reference.{}={}", rpm ? "speed_rpm" : "omega_e_rad_s",
                      list_text(rpm ? drive_.reference.speed_rpm : drive_.reference.omega_e_rad_s)),
          "load.T_load_Nm=" + list_text(drive_.load.T_load_Nm),
          "controller.compensation=" +
              list_text(drive_.controller.compensation, names(kCompensationNames)),
          "steering.n=" + list_text(steering_.n),
          "steering.policy=" + list_text(steering_.policy, names(kSteeredPolicyNames))};
}

bool was_steered(const RunLog& log) {
  return std::any_of(log.events.begin(), log.events.end(), [](const EventRecord& event) {
    return event.reason == static_cast<int>(Reason::kSteered) ||
           event.reason == static_cast<int>(Reason::kEmergencyStop) ||
           event.reason == static_cast<int>(Reason::kReset);
  });
}

std::vector<AppliedSteering> steering_in(const RunLog& log) {
  std::vector<AppliedSteering> applied;
  for (const EventRecord& event : log.events)
    if (event.reason == static_cast<int>(Reason::kSteered))
      applied.push_back({event.k, event.text});
  return applied;
}

namespace {
std::set<std::string_view> keys_of(std::string_view lines) {
  std::set<std::string_view> keys;
  for (const std::string_view line : lines_of(lines)) {
    const std::string_view key = line.substr(0, line.find('='));
    keys.insert(sets_the_speed(key) ? "speed" : key);
  }
  return keys;
}
}  // namespace

bool requests_rates(const RunLog& log) {
  const std::vector<AppliedSteering> requests = steering_in(log);
  return std::any_of(requests.begin(), requests.end(), [](const AppliedSteering& request) {
    const std::set<std::string_view> keys = keys_of(request.lines);
    return keys.contains("n") || keys.contains("policy");
  });
}

std::string why_not_applied(const std::vector<AppliedSteering>& requests, std::size_t i,
                            std::int64_t last_k) {
  if (requests[i].k > last_k) return "not applied: the run ended before";
  std::set<std::string_view> left = keys_of(requests[i].lines);
  for (std::size_t later = i + 1; later < requests.size() && !left.empty(); ++later) {
    if (requests[later].k >= requests[i].k) continue;
    for (const std::string_view key : keys_of(requests[later].lines)) left.erase(key);
    if (left.empty())
      return fmt::format("not applied: replaced by the request of tick {}", requests[later].k);
  }
  return "";
}

RateHistory rate_history(const RunLog& log, const DriveConfig& drive) {
  const std::vector<AppliedSteering> applied = steering_in(log);
  if (log.config_toml.empty() ||
      (applied.empty() && log.config_toml.find("[steering]") == std::string::npos))
    return {drive.gain.policy, drive.background_rate()};
  Config config = Config::parse(log.config_toml, log.path + " (DRIVE_MANIFEST)");
  SteeredDrive steered(config);
  for (const AppliedSteering& one : applied) steered.apply(one.lines, one.k);
  return steered.rates();
}

namespace {

// The plant reports its emergency stops: the report of tick k comes before k + 1 begins. The
// estimator reports the tick at which it restarted after a reset.
std::string emergencies_in(const RunLog& log, const DriveConfig& drive) {
  std::string text;
  for (const EventRecord& event : log.events) {
    const bool stop = event.reason == static_cast<int>(Reason::kEmergencyStop) &&
                      event.role == static_cast<int>(Role::kPlant);
    const bool reset = event.reason == static_cast<int>(Reason::kReset) &&
                       event.role == static_cast<int>(Role::kEstimator);
    if (!stop && !reset) continue;
    const double t_s = (static_cast<double>(stop ? event.k + 1 : event.k) - 0.5) * drive.T_s();
    if (t_s > 0) text += fmt::format(", [{}, \"{}\"]", t_s, stop ? "stop" : "reset");
  }
  return text.empty() ? "" : "steering.emergency=[[0, \"none\"]" + text + "]";
}

}  // namespace

std::vector<std::string> steered_overrides(Config& config, const RunLog& log, std::int64_t ticks) {
  SteeredDrive drive(config);
  for (const AppliedSteering& one : steering_in(log)) drive.apply(one.lines, one.k);
  std::vector<std::string> overrides = drive.overrides();
  if (std::string emergencies = emergencies_in(log, config.drive()); !emergencies.empty())
    overrides.push_back(std::move(emergencies));
  overrides.push_back(
      fmt::format("run.duration_s={}", static_cast<double>(ticks) * config.drive().T_s()));
  return overrides;
}

}  // namespace twinrate
