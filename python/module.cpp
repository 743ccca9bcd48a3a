// The Python module: the verbs, logs as numpy arrays, own parts of the loop written in Python.
//
// python/twinrate/__init__.py makes the user's functions of it. Every function here runs the
// library code of the programs. BadInput becomes ValueError with the program's line, MachineError
// OSError. Python runs while a verb does: no function but those with Python code in the loop keeps
// the interpreter's lock.
#include <fmt/format.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <iostream>
#include <limits>
#include <map>

#include "controller/controller_process.hpp"
#include "controller/reference_process.hpp"
#include "core/event_log.hpp"
#include "core/machine_error.hpp"
#include "core/process.hpp"
#include "core/seconds_since.hpp"
#include "estimator/estimator_process.hpp"
#include "estimator/own_filter.hpp"
#include "export/fields.hpp"
#include "loop/load_drive.hpp"
#include "model/math.hpp"
#include "report/svg.hpp"
#include "run/own_monitor.hpp"
#include "tools/run_verb.hpp"
#include "tools/simulate_verb.hpp"

namespace py = pybind11;

namespace twinrate {
namespace {

// ---- Arrays of a log -----------------------------------------------------------------------

template <class T>
py::array_t<T> array_of(std::vector<T> values, std::vector<py::ssize_t> shape) {
  auto* kept = new std::vector<T>(std::move(values));
  const py::capsule owner(kept, [](void* p) { delete static_cast<std::vector<T>*>(p); });
  return py::array_t<T>(std::move(shape), kept->data(), owner);
}

// The messages of one channel, a column for each field.
class Columns {
 public:
  void add(Channel channel, const lcm::LogEvent& event) {
    add(channel, event.data, static_cast<std::size_t>(event.datalen));
  }
  void add(Channel channel, const void* bytes, std::size_t size) {
    const bool first = k_.empty();
    if (!read_sample(channel, bytes, size, sample_, first ? &layout_ : nullptr)) return;
    if (first) {
      numbers_.resize(layout_.numbers.size());
      widths_.resize(layout_.numbers.size());
      texts_.resize(layout_.texts.size());
    }
    k_.push_back(sample_.k);
    t_ns_.push_back(sample_.t_ns);
    const double* at = sample_.numbers.data();
    for (std::size_t i = 0; i < numbers_.size(); ++i) {
      numbers_[i].insert(numbers_[i].end(), at, at + sample_.counts[i]);
      if (layout_.numbers[i].array) widths_[i].push_back(sample_.counts[i]);
      at += sample_.counts[i];
    }
    for (std::size_t i = 0; i < texts_.size(); ++i) texts_[i].push_back(sample_.texts[i]);
  }
  bool empty() const { return k_.empty(); }
  py::dict arrays() {
    const auto rows = static_cast<py::ssize_t>(k_.size());
    py::dict fields;
    fields["seq"] = array_of(std::move(k_), {rows});
    fields["t_ns"] = array_of(std::move(t_ns_), {rows});
    for (std::size_t i = 0; i < numbers_.size(); ++i)
      fields[layout_.numbers[i].name.c_str()] = column(i, rows);
    for (std::size_t i = 0; i < texts_.size(); ++i)
      fields[layout_.texts[i].c_str()] = py::cast(texts_[i]);
    return fields;
  }

 private:
  py::object column(std::size_t i, py::ssize_t rows) {
    const Field& field = layout_.numbers[i];
    if (field.array) return matrix(i, rows);
    if (field.kind == FieldKind::kHeld)
      return array_of(std::vector<std::int64_t>(numbers_[i].begin(), numbers_[i].end()), {rows});
    return array_of(std::move(numbers_[i]), {rows});
  }
  // A row a message; NaN behind a shorter array.
  py::object matrix(std::size_t i, py::ssize_t rows) {
    const auto& widths = widths_[i];
    const std::size_t widest = *std::max_element(widths.begin(), widths.end());
    const std::vector<py::ssize_t> shape = {rows, static_cast<py::ssize_t>(widest)};
    if (std::all_of(widths.begin(), widths.end(), [=](auto w) { return w == widest; }))
      return array_of(std::move(numbers_[i]), shape);
    std::vector<double> filled(static_cast<std::size_t>(rows) * widest,
                               std::numeric_limits<double>::quiet_NaN());
    const double* from = numbers_[i].data();
    for (std::size_t row = 0; row < widths.size(); from += widths[row++])
      std::copy_n(from, widths[row], &filled[row * widest]);
    return array_of(std::move(filled), shape);
  }

  Sample sample_;
  Layout layout_;
  std::vector<std::int64_t> k_, t_ns_;
  std::vector<std::vector<double>> numbers_;
  std::vector<std::vector<std::size_t>> widths_;  // of the arrays
  std::vector<std::vector<std::string>> texts_;
};

using Channels = std::map<Channel, Columns>;

py::dict arrays_of(Channels& channels) {
  py::dict result;
  for (auto& [channel, columns] : channels)
    if (!columns.empty())
      result[std::string_view(info(channel).name).substr(6).data()] = columns.arrays();
  return result;
}

py::dict read_log(const std::string& path, bool skip_damage) {
  Channels channels;
  std::string damage;
  {
    const py::gil_scoped_release python_runs;
    EventLog log(path, skip_damage ? OnDamage::kSkip : OnDamage::kRefuse);
    while (const lcm::LogEvent* event = log.next())
      if (const auto channel = log.channel(); channel && *channel != Channel::kAck)
        channels[*channel].add(*channel, *event);
    damage = log.damage();
  }
  py::dict result = arrays_of(channels);
  result["damage"] = damage;
  return result;
}

// ---- The bus -------------------------------------------------------------------------------

// Collects what comes over the bus for a time, any session.
class Capture {
 public:
  Capture(const std::string& url, const std::string& suffix) : lcm_(resolve_url(url)) {
    if (!lcm_.good()) throw MachineError("LCM cannot open its URL; try twinrate doctor");
    for (const ChannelInfo& channel : kChannels) {
      if (channel.channel == Channel::kAck) continue;
      ears_.push_back(std::make_unique<Ear>(Ear{this, channel.channel}));
      lcm::Subscription* s = lcm_.subscribe(channel.name + suffix, &Ear::hear, ears_.back().get());
      if (!s || lcm_.getFileno() < 0)
        throw MachineError("the LCM self-test failed; try twinrate doctor");
      s->setQueueCapacity(0);
    }
  }
  Channels run(double seconds) {
    const auto begun = std::chrono::steady_clock::now();
    while (seconds_since(begun) < seconds) lcm_.handleTimeout(20);
    return std::move(channels_);
  }

 private:
  struct Ear {
    Capture* capture;
    Channel channel;
    void hear(const lcm::ReceiveBuffer* buffer, const std::string&) {  // LCM takes no const member
      capture->channels_[channel].add(channel, buffer->data, buffer->data_size);
    }
  };
  lcm::LCM lcm_;
  std::vector<std::unique_ptr<Ear>> ears_;
  Channels channels_;
};

py::dict capture(double seconds, const std::string& url, const std::string& suffix) {
  Channels channels;
  {
    const py::gil_scoped_release python_runs;
    channels = Capture(url, suffix).run(seconds);
  }
  return arrays_of(channels);
}

// ---- Verbs ---------------------------------------------------------------------------------

// The verbs catch the stop signals; Python has its own handlers back afterwards.
class SignalsOfPython {
 public:
  SignalsOfPython() {
    sigaction(SIGINT, nullptr, &interrupt_);
    sigaction(SIGTERM, nullptr, &terminate_);
  }
  ~SignalsOfPython() {
    sigaction(SIGINT, &interrupt_, nullptr);
    sigaction(SIGTERM, &terminate_, nullptr);
  }
  SignalsOfPython(const SignalsOfPython&) = delete;
  SignalsOfPython& operator=(const SignalsOfPython&) = delete;

 private:
  struct sigaction interrupt_ {
  }, terminate_{};
};

int call(const std::vector<std::string>& arguments) {
  const py::gil_scoped_release python_runs;
  const SignalsOfPython signals;
  std::vector<const char*> argv = {"twinrate"};
  for (const std::string& argument : arguments) argv.push_back(argument.c_str());
  const auto flush = [] {
    std::cout.flush();
    std::fflush(stdout);
  };
  try {
    const int code = run_verb(static_cast<int>(argv.size()), argv.data());
    flush();
    return code;
  } catch (...) {
    flush();
    throw;
  }
}

// ---- Own parts in Python -------------------------------------------------------------------

template <class Vector>
py::array_t<double> numbers(const Vector& v, int count) {
  py::array_t<double> array(count);
  std::copy_n(v.data(), count, array.mutable_data());
  return array;
}

std::vector<double> numbers_from(const py::handle& object, std::size_t count, const char* what) {
  auto list = object.cast<std::vector<double>>();
  if (list.size() != count)
    throw BadInput(fmt::format("{}: {} numbers expected, found {}", what, count, list.size()));
  return list;
}

// A filter whose fast step is Python: python/twinrate/__init__.py describes the object.
class PythonFilter final : public OwnFilter {
 public:
  PythonFilter(Config& config, const py::object& make)
      : OwnFilter(config), object_(make(config.resolved())) {
    const Gain first = initial_gain();
    n_x_ = first.n_x;
    n_y_ = first.n_y;
    if (!has("fast_step")) throw BadInput("estimator: the object has no method fast_step(x, m, K)");
    fast_step_ = object_.attr("fast_step");
    if (has("output")) output_ = object_.attr("output");
  }
  FastState start(const Measurement& first) const override {
    FastState state = OwnFilter::start(first);
    if (has("start")) put(state, object_.attr("start")(first), "start()");
    return state;
  }
  Correction fast_step(FastState& state, const Measurement& m, const Gain& gain) const override {
    py::array_t<double> K({n_x_, n_y_});
    for (int row = 0; row < n_x_; ++row)
      for (int col = 0; col < n_y_; ++col) K.mutable_at(row, col) = gain.K(row, col);
    py::object result = fast_step_(numbers(state.x_hat, n_x_), m, K);
    Correction correction;
    if (py::isinstance<py::tuple>(result) && py::len(result) == 2) {
      const auto pair = result.cast<py::tuple>();
      const auto innov =
          numbers_from(pair[1], static_cast<std::size_t>(n_y_), "fast_step(): innov");
      std::copy(innov.begin(), innov.end(), correction.innov.data());
      result = pair[0];
    }
    if (!put(state, result, "fast_step(): x")) return {.innov = {}, .status = kNotFinite};
    return correction;
  }
  Estimate output(const FastState& state, const Measurement& m) const override {
    Estimate e = OwnFilter::output(state, m);
    if (!output_) return e;
    const auto named = output_(numbers(state.x_hat, n_x_), m).cast<py::dict>();
    const auto take = [&](const char* name, double& value) {
      if (named.contains(name)) value = named[name].cast<double>();
    };
    take("theta_e", e.theta_e);
    take("omega_m", e.omega_m);
    take("i_d", e.i_dq[0]);
    take("i_q", e.i_dq[1]);
    take("T_load", e.T_load);
    return e;
  }

 private:
  bool has(const char* name) const { return py::hasattr(object_, name); }
  // False, and nothing changed, where a number is not finite.
  bool put(FastState& state, const py::object& x, const char* what) const {
    const auto list = numbers_from(x, static_cast<std::size_t>(n_x_), what);
    if (!std::all_of(list.begin(), list.end(), [](double v) { return std::isfinite(v); }))
      return false;
    std::copy(list.begin(), list.end(), state.x_hat.data());
    return true;
  }

  py::object object_, fast_step_, output_;
  int n_x_ = 0, n_y_ = 0;
};

MakeFilter maker_of(const py::object& make) {
  if (make.is_none()) return make_filter;
  return [make](Config& config) -> std::shared_ptr<const Filter> {
    return std::make_shared<const PythonFilter>(config, make);
  };
}

class PythonController final : public Controller {
 public:
  PythonController(Config& config, const py::object& make)
      : object_(make(config.resolved())), step_(object_.attr("step")) {}
  std::string_view kind() const override { return "python"; }
  Command step(const ControllerInput& in) override {
    Command c;
    c.k = in.measurement.k;
    c.t_ns = in.measurement.t_ns;
    c.theta_ctrl = in.estimate.theta_e;
    c.omega_m_ref = in.reference.omega_m_ref;
    c.i_dq = park(clarke(in.measurement.i_abc), in.estimate.theta_e);
    const auto u = numbers_from(step_(in.measurement, in.estimate, in.reference), 2,
                                "step(): u_alpha, u_beta");
    c.u_alphabeta_ref = {u[0], u[1]};
    return c;
  }

 private:
  py::object object_, step_;
};

// The command line of a process, sys.argv.
struct Arguments {
  explicit Arguments(const std::vector<std::string>& list) : texts(list) {
    for (std::string& text : texts) pointers.push_back(text.data());
  }
  int count() const { return static_cast<int>(pointers.size()); }
  std::vector<std::string> texts;
  std::vector<char*> pointers;
};

int estimator_process(const std::vector<std::string>& argv, const py::object& make) {
  const SignalsOfPython signals;
  Arguments a(argv);
  return run_estimator(a.texts.at(0).c_str(), a.count(), a.pointers.data(), maker_of(make));
}

int controller_process(const std::vector<std::string>& argv, const py::object& make) {
  const SignalsOfPython signals;
  Arguments a(argv);
  return run_controller(
      a.texts.at(0).c_str(), a.count(), a.pointers.data(), [&](Config& config, Begin) {
        return std::make_unique<Guarded>(std::make_unique<PythonController>(config, make));
      });
}

int reference_process(const std::vector<std::string>& argv, const py::object& omega_m_ref) {
  const SignalsOfPython signals;
  Arguments a(argv);
  return run_reference(
      a.texts.at(0).c_str(), a.count(), a.pointers.data(),
      [&](const DriveConfig&, double t_s) { return omega_m_ref(t_s).cast<double>(); });
}

int simulated(const std::string& drive, const std::vector<std::string>& overrides,
              const std::string& run_dir, bool force, const py::object& make) {
  const SimulateOptions options{.drive = drive,
                                .run_dir = run_dir,
                                .overrides = overrides,
                                .force = force,
                                .quiet = true,
                                .make_monitor = make_own_monitor};
  const SignalsOfPython signals;
  catch_stop_signals();
  int code = 0;
  if (!make.is_none()) {
    code = simulate(options, maker_of(make));
  } else {
    const py::gil_scoped_release python_runs;
    code = simulate(options);
  }
  if (stop_signalled()) {
    PyErr_SetNone(PyExc_KeyboardInterrupt);
    throw py::error_already_set();
  }
  return code;
}

std::string resolved_drive(const std::string& drive, const std::vector<std::string>& overrides) {
  return load_drive(drive, overrides).resolved();
}

// Panels of curves, as the gallery of effects draws them: [(title, x_label, [(name, x, y)])].
std::string figure(
    const std::string& title,
    const std::vector<
        std::tuple<std::string, std::string,
                   std::vector<std::tuple<std::string, std::vector<double>, std::vector<double>>>>>&
        panels) {
  constexpr const char* kColours[] = {"#1f6fe5", "#e07b16", "#2c9a4b", "#8a8f98"};
  std::vector<gallery::Panel> drawn;
  for (const auto& [panel_title, x_label, curves] : panels) {
    gallery::Panel panel{.title = panel_title, .x_label = x_label};
    for (const auto& [name, x, y] : curves) {
      if (x.size() != y.size() || x.size() < 2)
        throw BadInput(
            fmt::format("figure: {}: x and y of equal length, 2 or more, expected, found {} and {}",
                        name, x.size(), y.size()));
      panel.curves.push_back({name, kColours[panel.curves.size() % std::size(kColours)], x, y});
    }
    drawn.push_back(panel);
  }
  return gallery::svg(title, drawn, "", {});
}

// ---- Binding -------------------------------------------------------------------------------

double seconds(std::int64_t t_ns) {
  return 1e-9 * static_cast<double>(t_ns);
}

// A vector as a tuple: a fast step in Python is made of single numbers.
template <class Owner, class Vector>
auto pair_of(Vector Owner::*member) {
  return [member](const Owner& o) { return py::make_tuple((o.*member)[0], (o.*member)[1]); };
}

void bind_signals(py::module_& m) {
  py::class_<Measurement>(m, "Measurement", "What the drive measured at t_k, SI units.")
      .def_readonly("k", &Measurement::k)
      .def_property_readonly("t", [](const Measurement& s) { return seconds(s.t_ns); })
      .def_property_readonly(
          "i_abc",
          [](const Measurement& s) { return py::make_tuple(s.i_abc[0], s.i_abc[1], s.i_abc[2]); })
      .def_property_readonly("i_alphabeta",
                             [](const Measurement& s) {
                               const Vec2 i = clarke(s.i_abc);
                               return py::make_tuple(i[0], i[1]);
                             })
      .def_property_readonly("u_alphabeta", pair_of(&Measurement::u_alphabeta))
      .def_readonly("signals", &Measurement::signals)
      .def_readonly("v_dc", &Measurement::v_dc)
      .def_readonly("theta_m", &Measurement::theta_m)
      .def_readonly("omega_m", &Measurement::omega_m);
  py::class_<Estimate>(m, "Estimate", "What the estimator knows at t_k, SI units.")
      .def_readonly("k", &Estimate::k)
      .def_property_readonly("t", [](const Estimate& s) { return seconds(s.t_ns); })
      .def_readonly("status", &Estimate::status)
      .def_readonly("theta_e", &Estimate::theta_e)
      .def_readonly("omega_m", &Estimate::omega_m)
      .def_property_readonly("i_dq", pair_of(&Estimate::i_dq))
      .def_readonly("T_load", &Estimate::T_load);
  py::class_<Reference>(m, "Reference", "What the drive is asked for at t_k, SI units.")
      .def_readonly("k", &Reference::k)
      .def_property_readonly("t", [](const Reference& s) { return seconds(s.t_ns); })
      .def_readonly("omega_m_ref", &Reference::omega_m_ref)
      .def_readonly("i_d_ref", &Reference::i_d_ref);
}

}  // namespace

PYBIND11_MODULE(_twinrate, m) {
  // NOLINTNEXTLINE(performance-unnecessary-value-param): the type that pybind11 takes
  py::register_exception_translator([](std::exception_ptr thrown) {
    try {
      if (thrown) std::rethrow_exception(thrown);
    } catch (const BadInput& error) {
      PyErr_SetString(PyExc_ValueError, error.what());
    } catch (const MachineError& error) {
      PyErr_SetString(PyExc_OSError, error.what());
    }
  });
  bind_signals(m);
  m.def("call", &call);
  m.def("stop_signalled", &stop_signalled);
  m.def("read_log", &read_log);
  m.def("capture", &capture);
  m.def("simulate", &simulated);
  m.def("resolved_drive", &resolved_drive);
  m.def("figure", &figure);
  m.def("sin", &math::sin);
  m.def("cos", &math::cos);
  m.def("run_estimator", &estimator_process);
  m.def("run_controller", &controller_process);
  m.def("run_reference", &reference_process);
}

}  // namespace twinrate
