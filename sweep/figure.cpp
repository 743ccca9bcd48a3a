#include "sweep/figure.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>
#include <map>

#include "loop/load_drive.hpp"
#include "sweep/store.hpp"

namespace twinrate::sweep {
namespace {

constexpr double kWidth = 560, kHeight = 420, kLeft = 64, kRight = 16, kTop = 34, kBottom = 52;
constexpr const char* kColours[] = {"#1f5fa8", "#c8501e", "#2c8a4b", "#7a3fa0",
                                    "#a88a1f", "#555555", "#0e8a8a"};
constexpr double kPaper_f_e_Hz = 400 / kTwoPi;

double nice_step(double span) {
  const double raw = span / 6, power = std::pow(10, std::floor(std::log10(raw)));
  for (double m : {1.0, 2.0, 5.0, 10.0})
    if (m * power >= raw) return m * power;
  return 10 * power;
}

// One panel: axes, grid and curves, clipped to the box.
class Panel {
 public:
  Panel(double x0, double x_max, double y_max) : x0_(x0), x_max_(x_max), y_max_(y_max) {}

  double x(double f_e) const { return x0_ + kLeft + f_e / x_max_ * (kWidth - kLeft - kRight); }
  double y(double f) const {
    return kHeight - kBottom - std::min(f / y_max_, 1.03) * (kHeight - kTop - kBottom);
  }
  std::string axes(const char* title, const char* y_label) const {
    std::string s = fmt::format(
        "<text x='{:.1f}' y='20' class='t'>{}</text>\n"
        "<text x='{:.1f}' y='{:.1f}' class='m'>f_e, Hz</text>\n"
        "<text transform='translate({:.1f} {:.1f}) rotate(-90)' class='m'>{}</text>\n",
        x0_ + kLeft, title, x0_ + (kLeft + kWidth - kRight) / 2, kHeight - 12, x0_ + 16,
        (kTop + kHeight - kBottom) / 2, y_label);
    for (double v = 0; v <= x_max_ * 1.0001; v += nice_step(x_max_))
      s += fmt::format(
          "<line class='g' x1='{0:.1f}' x2='{0:.1f}' y1='{1:.1f}' y2='{2:.1f}'/>"
          "<text x='{0:.1f}' y='{3:.1f}' class='m'>{4:g}</text>\n",
          x(v), y(0), y(y_max_), y(0) + 16, v);
    for (double v = 0; v <= y_max_ * 1.0001; v += nice_step(y_max_))
      s += fmt::format(
          "<line class='g' y1='{0:.1f}' y2='{0:.1f}' x1='{1:.1f}' x2='{2:.1f}'/>"
          "<text x='{3:.1f}' y='{4:.1f}' class='e'>{5:g}</text>\n",
          y(v), x(0), x(x_max_), x(0) - 6, y(v) + 4, v);
    return s;
  }
  std::string line(double f0, double v0, double f1, double v1) const {
    return fmt::format("<line class='r' x1='{:.1f}' y1='{:.1f}' x2='{:.1f}' y2='{:.1f}'/>\n", x(f0),
                       y(v0), x(f1), y(v1));
  }
  // Points measured in the paper: a ring if held, a cross if lost.
  std::string paper_points(double held, double lost) const {
    const double px = x(kPaper_f_e_Hz), h = y(held), l = y(lost);
    return fmt::format(
        "<circle cx='{0:.1f}' cy='{1:.1f}' r='6' fill='none' stroke='#000' stroke-width='1.5'/>\n"
        "<path d='M{2:.1f} {3:.1f}l10 10m0 -10l-10 10' stroke='#000' stroke-width='1.5'/>\n",
        px, h, px - 5, l - 5);
  }

 private:
  double x0_, x_max_, y_max_;
};

struct Curve {
  std::vector<const Limit*> limits;
  const char* colour = kColours[0];
};

std::map<std::string, Curve> curves_of(const std::vector<Limit>& limits) {
  std::map<std::string, Curve> curves;
  for (const Limit& l : limits) {
    if (l.policy == "scheduled" || l.n_max == 0) continue;
    const auto place =
        std::find(std::begin(kGainPolicyNames), std::end(kGainPolicyNames), l.policy) -
        std::begin(kGainPolicyNames);
    curves[l.policy].colour = kColours[static_cast<std::size_t>(place) % std::size(kColours)];
    curves[l.policy].limits.push_back(&l);
  }
  std::size_t next = 0;  // curves that are no policy alone take the colours in turn
  for (auto& [policy, curve] : curves)
    if (policy.find(' ') != std::string::npos)
      curve.colour = kColours[next++ % std::size(kColours)];
  for (auto& [policy, curve] : curves)
    std::sort(curve.limits.begin(), curve.limits.end(),
              [](const Limit* a, const Limit* b) { return a->f_e_Hz < b->f_e_Hz; });
  return curves;
}

// `scale`: ordinate of a ratio of 1.
template <class Scale>
std::string draw(const Panel& panel, const Curve& curve, Scale scale) {
  std::string path, marks;
  for (const Limit* l : curve.limits) {
    const double x = panel.x(l->f_e_Hz), y = panel.y(scale(*l, l->n_max));
    path += fmt::format("{}{:.1f} {:.1f}", path.empty() ? "M" : "L", x, y);
    marks += fmt::format("<path d='M{0:.1f} {1:.1f}V{2:.1f}' stroke='{3}' opacity='.5'/>", x,
                         panel.y(scale(*l, l->n_highest)),
                         panel.y(scale(*l, std::max(1, l->n_lowest))), curve.colour);
    marks += fmt::format("<circle cx='{:.1f}' cy='{:.1f}' r='3' fill='{}' stroke='{}'/>\n", x, y,
                         l->capped ? "#fff" : curve.colour, curve.colour);
  }
  return fmt::format("<path d='{}' fill='none' stroke='{}' stroke-width='1.5'/>\n{}", path,
                     curve.colour, marks);
}

std::string escaped(const std::string& text) {
  std::string out;
  for (const char c : text)
    out += c == '&' ? "&amp;" : c == '<' ? "&lt;" : c == '>' ? "&gt;" : std::string(1, c);
  return out;
}

std::string caption_text(const Caption& caption, double x) {
  const std::string ring =
      caption.paper_points ? "ring: 416 Hz held, cross: 384 Hz lost (paper, measured); " : "";
  return fmt::format(
      "<text x='{:.1f}' y='{}'>dashed: 7 a turn; {}hollow: no loss found; bars: seeds</text>\n"
      "<text x='{:.1f}' y='{}'>{}: {}</text>\n",
      x + 8, kHeight + 14, ring, kLeft, kHeight + 36, escaped(caption.drive),
      escaped(caption.command));
}

}  // namespace

bool is_motor_of_the_paper(const MachineParameters& m) {
  const MachineParameters paper = Config::load("dilys2021").drive().machine;
  return m.R_s == paper.R_s && m.L_d == paper.L_d && m.L_q == paper.L_q && m.psi_f == paper.psi_f &&
         m.n_p == paper.n_p;
}

void write_figure(const std::string& path, const std::vector<Limit>& limits,
                  const Caption& caption) {
  const auto curves = curves_of(limits);
  double f_e_max = 80, f_b_max = 100, ratio_max = 14;
  for (const auto& [policy, curve] : curves)
    for (const Limit* l : curve.limits) {
      f_e_max = std::max(f_e_max, 1.05 * l->f_e_Hz);
      f_b_max = std::max(f_b_max, 1.08 * l->f_bmin_Hz());
      ratio_max = std::max(ratio_max, std::min(36.0, 1.08 * l->ratio(l->n_max)));
    }
  const Panel left(0, f_e_max, std::max(f_b_max, 520.0)), right(kWidth, f_e_max, ratio_max);
  std::string svg = fmt::format(
      "<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {0} {1}' width='{0}' height='{1}'>\n"
      "<style>text{{font:12px sans-serif}}.t{{font-weight:bold;font-size:14px}}"
      ".m{{text-anchor:middle}}.e{{text-anchor:end}}.g{{stroke:#ddd}}"
      ".r{{stroke:#000;stroke-dasharray:6 4}}</style>\n<rect width='100%' height='100%' "
      "fill='#fff'/>\n",
      2 * kWidth, kHeight + 48);
  svg += left.axes("(a) lowest background rate", "f_bmin, Hz");
  svg += right.axes("(b) gains an electrical turn", "f_bmin / f_e");
  const double rule_f_e = std::min(f_e_max, std::max(f_b_max, 520.0) / 7);
  svg += left.line(0, 0, rule_f_e, 7 * rule_f_e) + right.line(0, 7, f_e_max, 7);
  double x = kLeft;
  for (const auto& [policy, curve] : curves) {
    svg += draw(left, curve, [](const Limit& l, int n) { return l.f_s_Hz / n; });
    svg += draw(right, curve, [](const Limit& l, int n) { return l.ratio(n); });
    svg += fmt::format(
        "<circle cx='{0:.1f}' cy='{1}' r='4' fill='{2}'/><text x='{3:.1f}' y='{4}'>{5}</text>\n", x,
        kHeight + 10, curve.colour, x + 8, kHeight + 14, policy);
    x += 34 + 7.0 * static_cast<double>(policy.size());
  }
  if (caption.paper_points) {
    svg += left.paper_points(416.7, 384.6);
    svg += right.paper_points(416.7 / kPaper_f_e_Hz, 384.6 / kPaper_f_e_Hz);
  }
  std::ofstream(path) << svg + caption_text(caption, x) + "</svg>\n";
}

void write_figure_of(const std::vector<std::string>& directories, const std::string& path) {
  std::vector<Limit> all;
  Caption caption;
  for (const std::string& directory : directories) {
    const std::string sweep_json = directory + "/sweep.json";
    std::ifstream file(sweep_json);
    if (!file) throw BadInput(sweep_json + ": no such file; a directory of sweep fb is needed");
    const std::string text{std::istreambuf_iterator<char>(file), {}};
    const Plan plan = plan_of(text);
    const Config config = load_drive(plan.drive, plan.overrides);
    if (!caption.drive.empty() && caption.drive != config.drive().name)
      throw BadInput(fmt::format("{}: a sweep of {}, the others are of {}", directory,
                                 config.drive().name, caption.drive));
    caption.drive = config.drive().name;
    caption.command += (caption.command.empty() ? "" : "; ") + command_of(plan);
    caption.paper_points = is_motor_of_the_paper(config.drive().machine);
    for (Limit& l : limits_of(plan, read_points(directory + "/points.csv"))) {
      l.policy = config.drive().estimator.kind + " " + l.policy;
      all.push_back(l);
    }
  }
  write_figure(path, all, caption);
}

}  // namespace twinrate::sweep
