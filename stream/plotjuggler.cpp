#include "stream/plotjuggler.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cmath>

#include "core/config.hpp"
#include "core/machine_error.hpp"

namespace twinrate {

std::vector<std::string> plotjuggler_datagrams(Channel channel, const Layout& layout,
                                               const Sample& sample) {
  const std::string head =
      fmt::format("{{\"timestamp\":{},\"{}\":{{\"seq\":{}", static_cast<double>(sample.t_ns) / 1e9,
                  std::string(info(channel).name).substr(6), sample.k);
  std::vector<std::string> datagrams{head};
  const auto add = [&](const std::string& member) {
    if (datagrams.back().size() + member.size() + 2 > kMaxDatagramBytes) datagrams.push_back(head);
    datagrams.back() += member;
  };
  std::size_t at = 0;
  for (std::size_t f = 0; f < layout.numbers.size(); ++f) {
    const Field& field = layout.numbers[f];
    for (std::size_t i = 0; i < sample.counts[f]; ++i, ++at) {
      const std::string name = field.array ? fmt::format("{}[{}]", field.name, i) : field.name;
      if (field.whole)
        add(fmt::format(",\"{}\":{}", name, sample.wholes[at]));
      else if (std::isfinite(sample.numbers[at]))
        add(fmt::format(",\"{}\":{}", name, sample.numbers[at]));
    }
  }
  for (std::string& text : datagrams) text += "}}";
  return datagrams;
}

std::string plotjuggler_layout() {
  const std::vector<std::vector<const char*>> plots{
      {"TRUTH/omega_m_rad_s", "ESTIMATE/omega_m_rad_s", "REFERENCE/omega_m_ref_rad_s"},
      {"MEASUREMENT/i_a_A", "MEASUREMENT/i_b_A", "MEASUREMENT/i_c_A"},
      {"MEASUREMENT/u_alpha_V", "MEASUREMENT/u_beta_V"},
      {"ESTIMATE/T_load_Nm", "TRUTH/T_load_Nm"}};
  const char* const colours[] = {"#1f77b4", "#d62728", "#2ca02c"};
  std::string sizes, areas;
  for (const auto& curves : plots) {
    sizes +=
        (sizes.empty() ? "" : ";") + fmt::format("{}", 1.0 / static_cast<double>(plots.size()));
    areas += "     <DockArea name=\"...\">\n      <plot style=\"Lines\" mode=\"TimeSeries\">\n";
    for (std::size_t i = 0; i < curves.size(); ++i)
      areas += fmt::format("       <curve name=\"/{}\" color=\"{}\"/>\n", curves[i], colours[i]);
    areas += "      </plot>\n     </DockArea>\n";
  }
  return fmt::format(
      "<?xml version='1.0' encoding='UTF-8'?>\n<root>\n"
      " <tabbed_widget parent=\"main_window\" name=\"Main Window\">\n"
      "  <Tab tab_name=\"drive\" containers=\"1\">\n   <Container>\n"
      "    <DockSplitter orientation=\"-\" sizes=\"{}\" count=\"{}\">\n{}"
      "    </DockSplitter>\n   </Container>\n  </Tab>\n  <currentTabIndex index=\"0\"/>\n"
      " </tabbed_widget>\n <use_relative_time_offset enabled=\"0\"/>\n</root>\n",
      sizes, plots.size(), areas);
}

PlotjugglerSender::PlotjugglerSender(const std::string& host, int port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(port));
  if (inet_pton(AF_INET, host.c_str(), &address.sin_addr) != 1)
    throw BadInput(fmt::format("--host {}: an IPv4 address such as 127.0.0.1 allowed", host));
  socket_ = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (socket_ < 0 || connect(socket_, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0) {
    if (socket_ >= 0) close(socket_);
    throw MachineError(fmt::format("no way to {}:{} from this machine", host, port));
  }
}

PlotjugglerSender::~PlotjugglerSender() {
  close(socket_);
}

void PlotjugglerSender::send(Channel channel, const Layout& layout, const Sample& sample) {
  for (const std::string& text : plotjuggler_datagrams(channel, layout, sample)) {
    if (::send(socket_, text.data(), text.size(), MSG_NOSIGNAL) >= 0)
      ++sent_;
    else if (errno == ECONNREFUSED)  // caused by an earlier datagram; this one was not sent
      ++unheard_;
    else
      ++lost_;
  }
}

}  // namespace twinrate
