#include "trace/change_points.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <mutex>
#include <set>

#include "model/effects/catalogue.hpp"
#include "trace/contest.hpp"
#include "trace/gate.hpp"
#include "trace/keys.hpp"
#include "trace/parallel.hpp"
#include "trace/suspicion.hpp"
#include "trace/thinning.hpp"

namespace twinrate {
namespace {

constexpr double kShortest_s = 1;  // least duration of a part that is traced alone
constexpr int kDepth = 2;          // levels of halving: four parts at most

template <class T>
std::vector<T> part(const std::vector<T>& x, std::size_t first, std::size_t end) {
  if (x.empty()) return {};
  return {x.begin() + static_cast<std::ptrdiff_t>(first),
          x.begin() + static_cast<std::ptrdiff_t>(end)};
}

Record part(const Record& whole, std::size_t first, std::size_t end) {
  Record r = whole;
  r.t = part(whole.t, first, end);
  r.u_alphabeta = part(whole.u_alphabeta, first, end);
  r.i_alphabeta = part(whole.i_alphabeta, first, end);
  r.theta_m = part(whole.theta_m, first, end);
  r.v_dc = part(whole.v_dc, first, end);
  r.T_load = part(whole.T_load, first, end);
  r.electrical_ok = part(whole.electrical_ok, first, end);
  r.motion_ok = part(whole.motion_ok, first, end);
  return r;
}

// Rows [first, end).
struct Range {
  std::size_t first = 0, end = 0;
};

// Rows [first, end) of the record, traced alone.
struct Part {
  std::size_t first = 0, end = 0;
  TraceResult result;
  Effects effects() const {
    Effects some;
    for (const TracedEffect& e : result.effects)
      if (!e.from_samples) some.push_back(e.effect);
    return some;
  }
};

class Search {
 public:
  Search(const Record& record, const DriveConfig& drive, const Health& health,
         const TraceSettings& settings, std::vector<char> held_out)
      : record_(record),
        drive_(drive),
        health_(health),
        settings_(settings),
        held_out_(std::move(held_out)) {}

  // Splits `whole` at the changes of the drive; parts in order of time.
  std::vector<Part> split(Part whole, int depth) {
    if (depth == 0 || whole.result.interrupted || !whole.result.inconsistent.empty())
      return one(whole);
    const std::vector<std::size_t> files = seams(whole);
    const auto row =
        suspicious_row(part(record_, whole.first, whole.end), drive_, whole.effects(), files);
    if (!row) return one(whole);
    if (!files.empty()) {
      std::vector<Part> parts = by_files(whole, files);
      if (parts.size() > 1) return split_each(std::move(parts), depth - 1);
      if (std::count(files.begin(), files.end(), *row)) return one(whole);
    }
    std::vector<Part> sides = at_moment(whole, whole.first + *row);
    return sides.empty() ? one(whole) : split_each(std::move(sides), depth - 1);
  }
  std::vector<Change> changes() {
    std::sort(changes_.begin(), changes_.end(),
              [](const Change& a, const Change& b) { return a.first < b.first; });
    return changes_;
  }
  std::vector<std::string> files_of(const Part& p) const {
    std::vector<std::string> some;
    for (const SourceRows& file : settings_.files)
      if (file.first < p.end && file.end > p.first) some.push_back(file.path);
    return some;
  }

  // True if the rows of a part exclude an effect: added to the effects found there, it makes their
  // error larger. An effect of the bus voltage alone is in none of the compared errors.
  bool excludes(const Part& p, const TracedEffect& e) const {
    const Effects there = p.effects();
    Effects with = there;
    with.push_back(e.effect);
    const bool first = p.first == 0;
    const Contest contest(record_, drive_, first ? there : with, first ? with : there,
                          first ? p.end : p.first);
    return std::any_of(there.begin(), there.end(),
                       [&](const auto& x) { return x->kind() == e.effect->kind(); }) ||
           contest.better(!first, p.first, p.end, held_out_).p <= Criterion{}.chance;
  }

  // "part from 0 to 4.3 s", "part a.csv".
  std::string part_in_words(const Part& p) const {
    const std::vector<std::string> files = files_of(p);
    if (settings_.files.size() > 1) return fmt::format("part {}", fmt::join(files, ", "));
    return fmt::format("part from {:.4g} to {:.4g} s", record_.t[p.first], record_.t[p.end - 1]);
  }

 private:
  // The two sides of a proven change near a row, without the rows of its range; empty: no change.
  std::vector<Part> at_moment(const Part& whole, std::size_t row) {
    const auto least = static_cast<std::size_t>(kShortest_s / record_.T_s);
    std::size_t end = row, first = row;
    std::optional<Change> change;
    std::vector<Part> sides;
    for (int round = 0; round < 2; ++round) {
      if (end < whole.first + least || first + least > whole.end) return {};
      sides = both_traced({whole.first, end}, {first, whole.end});
      change = proven(sides.front(), sides.back(), whole);
      if (!change || differ_by_a_load(sides.front().effects(), sides.back().effects())) return {};
      end = change->first, first = change->end;
    }
    changes_.push_back(*change);
    return sides;
  }
  // Splits into files that differ from the one before; one part if none does.
  std::vector<Part> by_files(const Part& whole, std::vector<std::size_t> seams) {
    const auto least = static_cast<std::size_t>(kShortest_s / record_.T_s);
    seams.push_back(whole.end - whole.first);
    std::vector<Part> parts;
    std::vector<Change> changes;
    std::size_t first = whole.first;
    for (const std::size_t seam : seams) {
      const std::size_t end = whole.first + seam;
      if (end < first + least) return {};
      Part file = traced(first, end);
      first = end;
      std::optional<Change> change;
      if (!parts.empty()) change = proven(parts.back(), file, whole);
      if (!parts.empty() && !change) {
        parts.back() = traced(parts.back().first, end);
        continue;
      }
      if (change) {
        change->between = border(file.first);
        change->t_s = change->from_s = change->to_s = 0;
        change->first = change->end = file.first;
        changes.push_back(*change);
      }
      parts.push_back(std::move(file));
    }
    changes_.insert(changes_.end(), changes.begin(), changes.end());
    return parts;
  }
  std::vector<Part> split_each(std::vector<Part> parts, int depth) {
    std::vector<Part> all;
    for (Part& p : parts) {
      std::vector<Part> some = split(std::move(p), depth);
      std::move(some.begin(), some.end(), std::back_inserter(all));
    }
    return all;
  }
  const SourceRows* file_at(std::size_t row) const {
    for (const SourceRows& file : settings_.files)
      if (row >= file.first && row < file.end) return &file;
    return nullptr;
  }
  // "a.csv and b.csv" if a file begins at this row.
  std::string border(std::size_t row) const {
    for (std::size_t f = 1; f < settings_.files.size(); ++f)
      if (settings_.files[f].first == row)
        return settings_.files[f - 1].path + " and " + settings_.files[f].path;
    return "";
  }
  static std::vector<Part> one(Part& whole) {
    std::vector<Part> parts;
    parts.push_back(std::move(whole));
    return parts;
  }
  std::vector<std::size_t> seams(const Part& p) const {
    std::vector<std::size_t> rows;
    for (const SourceRows& file : settings_.files)
      if (file.first > p.first && file.first < p.end) rows.push_back(file.first - p.first);
    return rows;
  }
  // Two ranges of rows without a common row, traced at the same time. Progress of the second is
  // told when the first is done.
  std::vector<Part> both_traced(Range one, Range two) {
    std::mutex guard;
    std::vector<std::string> later;
    std::vector<Part> parts(2);
    for_each_index(2, [&](std::size_t n) {
      TraceSettings settings = settings_;
      if (n == 1 && settings_.say)
        settings.say = [&](const std::string& line) { later.push_back(line); };
      if (settings_.stop)
        settings.stop = [&] {
          const std::lock_guard lock(guard);
          return settings_.stop();
        };
      const Range& range = n == 0 ? one : two;
      parts[n] = traced(range.first, range.end, std::move(settings));
    });
    for (const std::string& line : later) settings_.say(line);
    return parts;
  }
  Part traced(std::size_t first, std::size_t end) { return traced(first, end, settings_); }
  Part traced(std::size_t first, std::size_t end, TraceSettings settings) {
    settings.fit_judging_rows = false;  // they must prove the change
    settings.files.clear();
    for (SourceRows file : settings_.files) {
      file.first = std::max(file.first, first), file.end = std::min(file.end, end);
      if (file.first >= file.end) continue;
      file.first -= first, file.end -= first;
      settings.files.push_back(file);
    }
    Part traced{first, end,
                trace_record(part(record_, first, end), drive_, health_, settings,
                             part(held_out_, first, end))};
    for (std::size_t k = 0; k < traced.result.judging.size(); ++k)
      if (!traced.result.judging[k]) held_out_[first + k] = 0;  // they were fitted
    return traced;
  }
  std::optional<Change> proven(const Part& before, const Part& behind, const Part& whole) const {
    if (!before.result.inconsistent.empty() || !behind.result.inconsistent.empty())
      return std::nullopt;
    const Effects one = before.effects(), two = behind.effects();
    if (one.empty() && two.empty()) return std::nullopt;
    for (const Effects* effects : {&one, &two})
      for (const Part* part : {&before, &behind})
        if (turns_too_fast(*effects, *part)) return std::nullopt;
    const Contest contest(record_, drive_, one, two, behind.first);
    const Contest::Side first = contest.better(false, before.first, before.end, held_out_),
                        second = contest.better(true, behind.first, behind.end, held_out_);
    if (std::max(first.p, second.p) > Criterion{}.chance ||
        !beats(whole.effects(), before, behind, std::max(first.fall, second.fall)))
      return std::nullopt;
    const auto [from, at, to] = contest.moment(whole.first, whole.end);
    const SourceRows* file = file_at(at);
    const double offset = file ? file->time_offset_s : 0;
    Change change{.t_s = record_.t[at] - offset,
                  .from_s = record_.t[from] - offset,
                  .to_s = record_.t[to] - offset,
                  .between = {},
                  .file = file && settings_.files.size() > 1 ? file->path : "",
                  .first = from,
                  .end = to + 1};
    return change;
  }

  // True if an effect passes its periods faster, in half of the moving rows of a part, than the rows
  // resolve. They show its alias there, which differs from the effect on slower rows.
  bool turns_too_fast(const Effects& effects, const Part& p) const {
    constexpr double kResolved = 0.25;  // periods a row: by design, their mean is 0.9 of the value
    std::vector<double> turned;         // from row to row
    for (std::size_t k = p.first + 1; k < p.end; ++k)
      if (record_.motion_ok[k])
        turned.push_back(std::abs(record_.theta_m[k] - record_.theta_m[k - 1]) / kTwoPi);
    if (turned.empty()) return false;
    const auto middle = turned.begin() + static_cast<std::ptrdiff_t>(turned.size() / 2);
    std::nth_element(turned.begin(), middle, turned.end());
    return std::any_of(effects.begin(), effects.end(), [&](const auto& effect) {
      const std::string_view key = effect->tracing().traits().period.order_key;
      return !key.empty() && get_key(*effect, std::string(key)) * *middle > kResolved;
    });
  }

  // True if either side explains its rows better than the effects of the whole record do (a load
  // step is no change of the drive), by a share of `apart`, the fall between the two sides. True as
  // well if both sides explain them equally well with fewer effects (a friction that begins is no
  // series of load steps).
  bool beats(const Effects& whole, const Part& before, const Part& behind, double apart) const {
    // By design: below it the whole explains nearly all of the difference between the sides (a
    // winding that warms is no other resistance). It leaves 0.29 and more of a jump of the angle's
    // zero, and 0.07 of a warming winding.
    constexpr double kShare = 0.15;
    const double chance = Criterion{}.chance;
    const Effects one = before.effects(), two = behind.effects();
    const Contest first(record_, drive_, one, whole, behind.first),
        second(record_, drive_, whole, two, behind.first);
    const std::array better = {first.better(false, before.first, before.end, held_out_),
                               second.better(true, behind.first, behind.end, held_out_)};
    for (const Contest::Side& side : better)
      if (side.p <= chance && side.fall > kShare * apart) return true;
    return one.size() + two.size() < whole.size() &&
           first.better(true, before.first, before.end, held_out_).p > chance &&
           second.better(false, behind.first, behind.end, held_out_).p > chance;
  }

  const Record& record_;
  const DriveConfig& drive_;
  const Health& health_;
  const TraceSettings& settings_;
  std::vector<char> held_out_;  // rows that no fit has read
  std::vector<Change> changes_;
};

// The kind of an effect, as in "cogging of order 12", with its aliases.
std::string name_of(const TracedEffect& e) {
  std::string name(e.effect->kind());
  for (const TracedParameter& p : e.parameters)
    if (p.name == "order") name += fmt::format(" of order {:.4g}", p.value);
  return e.aliases.empty() ? name : fmt::format("{} (or {})", name, fmt::join(e.aliases, ", "));
}

// The kinds of all effects of a part, or "nothing named".
std::string kinds_of(const TraceResult& r) {
  std::vector<std::string> kinds;
  for (const TracedEffect& e : r.effects)
    if (!e.from_samples) kinds.push_back(name_of(e));
  return kinds.empty() ? "nothing named" : fmt::format("{}", fmt::join(kinds, ", "));
}

std::string when(const Change& c) {
  if (!c.between.empty()) return "between " + c.between;
  return fmt::format("at {:.4g} s{} (between {:.4g} and {:.4g} s)", c.t_s,
                     c.file.empty() ? "" : " of " + c.file, c.from_s, c.to_s);
}

// True if two parts have the same effect, within the uncertainty of both.
bool same(const TracedEffect& a, const TracedEffect& b) {
  constexpr double kSigmas = 4, kShare = 0.05;
  if (a.effect->kind() != b.effect->kind() || a.parameters.size() != b.parameters.size())
    return false;
  for (std::size_t k = 0; k < a.parameters.size(); ++k) {
    const TracedParameter &x = a.parameters[k], &y = b.parameters[k];
    const double sigma = std::hypot(x.sigma.value_or(0), y.sigma.value_or(0));
    const double allowed = std::max(kSigmas * sigma, kShare * std::abs(x.value));
    if (x.text != y.text || std::abs(x.value - y.value) > allowed) return false;
  }
  return true;
}

// Marks the effects of a part that all other parts have as well.
std::vector<char> throughout(const std::vector<Part>& parts, std::size_t main) {
  std::vector<char> all;
  for (const TracedEffect& e : parts[main].result.effects)
    all.push_back(std::all_of(parts.begin(), parts.end(), [&](const Part& p) {
      return std::any_of(p.result.effects.begin(), p.result.effects.end(),
                         [&](const TracedEffect& other) { return same(e, other); });
    }));
  return all;
}

// Gives the effects of a part its borders, if the rows beyond a border exclude the effect. Returns
// the kinds that they do not exclude.
std::vector<std::string> bound(std::vector<Part>& parts, std::size_t n,
                               const std::vector<Change>& changes, const Search& search) {
  TraceResult& r = parts[n].result;
  std::vector<std::string> open;
  for (TracedEffect& e : r.stop_gaps) e.only_in_part = true;
  for (TracedEffect& e : r.effects) {
    if (e.from_samples) continue;
    e.only_in_part = true;
    e.files = search.files_of(parts[n]);
    bool ends = true;
    const auto border = [&](const Change& change, const Part& beyond) {
      std::optional<double> at;
      if (!change.between.empty()) return at;
      if (search.excludes(beyond, e)) at = change.t_s;
      ends = ends && at;
      return at;
    };
    if (n > 0) e.from_s = border(changes[n - 1], parts[n - 1]);
    if (n < changes.size()) e.to_s = border(changes[n], parts[n + 1]);
    if (!ends) open.push_back(std::string(e.effect->kind()));
  }
  return open;
}

// True if the parts differ only in the zero of the angle, which concerns the reading, not the
// drive.
bool only_the_zero(const TraceResult& r) {
  const std::string_view zero = make_of(Traits::Family::kAngleSensor)->kind();
  return std::all_of(r.effects.begin(), r.effects.end(), [&](const TracedEffect& e) {
    return !e.only_in_part || e.effect->kind() == zero;
  });
}

// The verdict of several parts is the most doubtful one.
std::size_t rank(const std::string& verdict) {
  const char* const kVerdicts[] = {"nothing_missing", "traced", "ambiguous", "unexplained"};
  return static_cast<std::size_t>(std::find(std::begin(kVerdicts), std::end(kVerdicts), verdict) -
                                  std::begin(kVerdicts));
}

// The beginning of a headline if the verdict is not `traced`.
const char* begins(const std::string& verdict) {
  return verdict == "unexplained" ? "Unexplained in part. "
         : verdict == "ambiguous" ? "Ambiguous in part, see the aliases. "
                                  : "";
}

TraceResult together(std::vector<Part> parts, const std::vector<Change>& changes,
                     const Search& search) {
  std::size_t longest = 0;
  std::vector<std::string> told, open;
  std::vector<std::vector<std::string>> open_in;
  for (std::size_t n = 0; n < parts.size(); ++n) {
    if (parts[n].end - parts[n].first > parts[longest].end - parts[longest].first) longest = n;
    open_in.push_back(bound(parts, n, changes, search));
    told.push_back(kinds_of(parts[n].result));
  }
  const Part& main = parts[longest];
  TraceResult r = main.result;
  const std::vector<char> stays = throughout(parts, longest);
  for (std::size_t m = 0; m < stays.size(); ++m)
    if (stays[m] && !r.effects[m].from_samples) {
      r.effects[m].only_in_part = false;
      r.effects[m].from_s.reset(), r.effects[m].to_s.reset();
      r.effects[m].files.clear();
      std::erase(open_in[longest], r.effects[m].effect->kind());
    }
  for (const std::vector<std::string>& kinds : open_in)
    for (const std::string& kind : kinds)
      if (std::find(open.begin(), open.end(), kind) == open.end()) open.push_back(kind);
  std::vector<std::string> moments;
  for (std::size_t n = 0; n < changes.size(); ++n) {
    moments.push_back(when(changes[n]));
    r.changes.push_back({changes[n].t_s, changes[n].from_s, changes[n].to_s, changes[n].file,
                         changes[n].between, told[n], told[n + 1]});
  }
  std::string steps = told.front();
  for (std::size_t n = 1; n < told.size(); ++n) steps += ", then " + told[n];
  for (std::size_t n = 0; n < parts.size(); ++n) {
    if (n == longest) continue;
    for (TracedEffect& e : parts[n].result.effects) {
      const auto of_all = [&](const TracedEffect& x) { return !x.only_in_part && same(x, e); };
      if (e.from_samples || std::any_of(r.effects.begin(), r.effects.end(), of_all)) continue;
      e.views.clear();
      r.effects.push_back(std::move(e));
    }
    const TraceResult& other = parts[n].result;
    for (const FileError& file : other.files)
      if (std::none_of(r.files.begin(), r.files.end(),
                       [&](const FileError& f) { return f.path == file.path; }))
        r.files.push_back(file);
    r.ambiguous.insert(r.ambiguous.end(), other.ambiguous.begin(), other.ambiguous.end());
    r.unexplained.insert(r.unexplained.end(), other.unexplained.begin(), other.unexplained.end());
    r.refused.insert(r.refused.end(), other.refused.begin(), other.refused.end());
    r.structured = !r.unexplained.empty();
    if (rank(other.verdict) > rank(r.verdict)) r.verdict = other.verdict;
  }
  if (!open.empty())
    steps += fmt::format(" (the data do not show that {} {} not there in the other part)",
                         fmt::join(open, " and "), open.size() == 1 ? "is" : "are");
  r.sentence = fmt::format("{}{} {}: {}. Errors and pictures are of the {}: {}", begins(r.verdict),
                           only_the_zero(r) ? "The zero of theta_m changes" : "The drive changes",
                           fmt::join(moments, " and "), steps, search.part_in_words(main),
                           main.result.sentence);
  return r;
}

}  // namespace

bool differ_by_a_load(const Effects& one, const Effects& two) {
  std::array<std::multiset<std::string_view>, 2> loads, others;
  for_each_index(2, [&](std::size_t side) {
    for (const auto& effect : side == 0 ? one : two)
      (is_of(*effect, Traits::Family::kLoad) ? loads : others)[side].insert(effect->kind());
  });
  return others[0] == others[1] && (others[0].empty() || loads[0] != loads[1]);
}

TraceResult trace_with_changes(const Record& record, const DriveConfig& drive, const Health& health,
                               const TraceSettings& settings, std::vector<char> held_out) {
  TraceResult whole = trace_record(record, drive, health, settings, held_out);
  if (settings.stop && settings.stop()) return whole;
  // A file that judges has no fitted rows that could name a change in it.
  if (std::any_of(settings.files.begin(), settings.files.end(),
                  [](const SourceRows& file) { return file.held_out; }))
    return whole;
  if (whole.judging.size() == record.size()) held_out = whole.judging;
  if (held_out.empty()) held_out = held_out_rows(record, settings.holdout, drive.machine.n_p);
  Search search(record, drive, health, settings, held_out);
  Part all{0, record.size(), whole};
  std::vector<Part> parts;
  try {
    parts = search.split(std::move(all), kDepth);
  } catch (const TraceStopped&) {
    return whole;
  }
  if (parts.size() < 2) return whole;
  return together(std::move(parts), search.changes(), search);
}

}  // namespace twinrate
