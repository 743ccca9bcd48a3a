// The requests of the page, without a socket: a path with parameters -> an answer.
//
//   GET  /api/info                           the drive, the runs, whether it is live
//   GET  /api/tree                           signals with their newest values, channels, processes
//   GET  /api/events?from=N&source=          events from the N-th on
//   GET  /api/data?signals=A,B&from&to&bucket  minimum and maximum of each bucket of ticks: float64,
//                                            all minima of A, all maxima of A, those of B ..
//   GET  /api/samples?signals&from&to&bucket every bucket-th tick, float64
//   GET  /api/statistics?signals&from&to     min, max, mean, rms, peak to peak of every tick
//   GET  /api/csv?signals&from&to            the ticks as CSV; trace=1: as a drive log for `trace`
//   GET  /api/align?ghost&by&k               ticks by which a ghost is shifted
//   POST /api/trigger                        {mode, signal | event, edge, level, ..} or {force: true}
//   POST /api/control                        {client, take: true | false}
//   POST /api/request                        {client, kind, text}
//   POST /api/trace                          {from, to, capture}: `twinrate trace` of these ticks
//   GET  /trace?id=N                         its page
//
// `source` (default: the drive of this scope) and `capture` choose the ticks that are read. Bad
// input is answered with status 400 and one line. Thread-safe.
#pragma once
#include <map>
#include <mutex>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "scope/live_drive.hpp"
#include "scope/sources.hpp"
#include "scope/traces.hpp"

namespace twinrate::scope {

struct Query {
  std::string path;
  std::map<std::string, std::string> parameters;
  std::string body;  // of a POST request
  bool post = false;
};

struct Answer {
  int status = 200;
  std::string type = "application/json";
  std::string body;
  std::string file_name;  // the browser saves the body under this name; "": shows it
};

class Api {
 public:
  // `live`: null for a log. `title`: name of the source on the page. The functions that the part
  // `http` calls are virtual, because that part is not linked with this library.
  Api(Sources& sources, LiveDrive* live, std::string title, Traces& traces);

  virtual ~Api() = default;
  virtual Answer answer(const Query& query);
  // State of a page that follows the drive and gets a frame 20 times a second: the complete buckets
  // from `next` on, after which `next` advances.
  struct Stream {
    std::vector<std::string> signals;
    std::int64_t bucket = 1, next = -1, generation = -1;
    std::size_t events = 0;
    std::string client;
  };
  virtual Stream open_stream(const Query& query);
  virtual std::string frame(Stream& stream);

 private:
  using Json = nlohmann::ordered_json;
  struct Reader;  // source, capture, signals and range of a query
  Reader read(const Query& query, std::int64_t most_values);
  Answer info();
  Answer data(const Query& query);
  Answer samples(const Query& query);
  Answer statistics(const Query& query);
  Answer csv(const Query& query);
  static std::int64_t first_trigger(const Recording& run, TriggerSettings settings);
  Answer align(const Query& query);
  Answer set_trigger(const Json& body);
  Answer control(const Json& body);
  Answer request(const Json& body);
  Answer trace(const Json& body);
  Steering::Replies send(const std::string& kind, const std::string& text);
  void add_series(Stream& stream, std::int64_t end, Json& frame);
  void add_tail(const Stream& stream, std::int64_t end, Json& frame);
  void expire_holder();  // under mutex_
  Json live_state() const;

  Sources& sources_;
  LiveDrive* live_;
  std::string title_;
  Traces& traces_;
  std::mutex mutex_;  // of the holder
  std::string holder_;
  double holder_seen_s_ = 0;
};

}  // namespace twinrate::scope
