#include "core/man_page.hpp"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>

#include "core/paths.hpp"

namespace twinrate {
namespace {

// Text in troff: no line begins with a request, a hyphen of an option is a minus.
std::string troff(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '\\')
      out += "\\e";
    else if (c == '-')
      out += "\\-";
    else
      out += c;
  }
  for (const char start : {'.', '\''})
    if (out.starts_with(start)) out.insert(0, "\\&");
  for (auto at = out.find('\n'); at != std::string::npos; at = out.find('\n', at + 1))
    if (at + 1 < out.size() && (out[at + 1] == '.' || out[at + 1] == '\''))
      out.insert(at + 1, "\\&");
  return out;
}

std::string synopsis(const CLI::App& app, const std::string& command) {
  std::string line = fmt::format(".B {}\n", troff(command));
  if (!app.get_subcommands([](const CLI::App* a) { return !a->get_group().empty(); }).empty())
    return line + ".I VERB\n[options]\n";
  for (const CLI::Option* option : app.get_options())
    if (option->get_positional()) line += fmt::format(".I {}\n", troff(option->get_name(true)));
  return line + "[options]\n";
}

}  // namespace

std::string man_page(const CLI::App& app, const std::string& name) {
  std::string command = name;
  if (name.starts_with("twinrate-") && app.get_parent()) command.replace(8, 1, " ");
  std::string upper = name;
  std::transform(upper.begin(), upper.end(), upper.begin(),
                 [](char c) { return static_cast<char>(std::toupper(c)); });
  const std::string purpose = app.get_description().substr(app.get_description().rfind('\n') + 1);
  std::string page =
      fmt::format(".TH {} 1 \"\" \"twinrate {}\"\n.SH NAME\n{} \\- {}\n.SH SYNOPSIS\n{}", upper,
                  revision(), name, troff(purpose), synopsis(app, command));
  const auto verbs = app.get_subcommands([](const CLI::App* a) { return !a->get_group().empty(); });
  if (!verbs.empty()) page += ".SH VERBS\n";
  for (const CLI::App* verb : verbs)
    page +=
        fmt::format(".TP\n.B {}\n{}\n", troff(verb->get_name()), troff(verb->get_description()));
  page += ".SH OPTIONS\n";
  for (const CLI::Option* option : app.get_options()) {
    if (option->get_group().empty()) continue;
    page += fmt::format(".TP\n.B {}\n{}\n", troff(option->get_name(option->get_positional(), true)),
                        troff(option->get_description()));
  }
  if (!app.get_footer().empty())
    page += fmt::format(".SH NOTES\n.nf\n{}\n.fi\n", troff(app.get_footer()));
  return page +
         ".SH EXIT STATUS\n0 done, 1 the run ended badly, 2 bad input, 3 the machine cannot do "
         "it.\n";
}

}  // namespace twinrate
