// twinrate pages: man pages of the verbs and the completion of a shell, from the options themselves.
// For the package; not listed by --help.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include "core/man_page.hpp"
#include "core/output_file.hpp"
#include "tools/verb.hpp"

namespace twinrate {
namespace {

std::vector<CLI::App*> shown(CLI::App& app) {
  return app.get_subcommands([](CLI::App* verb) { return !verb->get_group().empty(); });
}

void write_man_pages(CLI::App& app, const std::string& name, const std::string& directory) {
  write_new(fmt::format("{}/{}.1", directory, name), man_page(app, name));
  for (CLI::App* verb : shown(app))
    write_man_pages(*verb, name + "-" + verb->get_name(), directory);
}

std::string words_of(CLI::App& app) {
  std::vector<std::string> words;
  for (const CLI::App* verb : shown(app)) words.push_back(verb->get_name());
  for (const CLI::Option* option : app.get_options())
    for (const std::string& name : option->get_lnames()) words.push_back("--" + name);
  return fmt::format("{}", fmt::join(words, " "));
}

// One line for each verb: the words that may follow it.
std::string cases(CLI::App& app, const std::string& verbs) {
  std::string lines = fmt::format("    \"{}\") words=\"{}\" ;;\n", verbs, words_of(app));
  for (CLI::App* verb : shown(app)) lines += cases(*verb, verbs + " " + verb->get_name());
  return lines;
}

// Verbs, options, presets; then files.
std::string bash_completion(CLI::App& app) {
  return fmt::format(R"(# bash completion of twinrate
_twinrate() {{
  local word=${{COMP_WORDS[COMP_CWORD]}} verbs="" words="" i
  for ((i = 1; i < COMP_CWORD; i++)); do
    [[ ${{COMP_WORDS[i]}} == [a-z]* && $i -le 2 ]] && verbs+=" ${{COMP_WORDS[i]}}"
  done
  while :; do
    case "$verbs" in
{}    esac
    [[ -n $words || -z $verbs ]] && break
    verbs=${{verbs% *}}
  done
  COMPREPLY=($(compgen -W "$words" -- "$word"))
  [[ -z $verbs ]] || COMPREPLY+=($(compgen -f -- "$word"))
}}
complete -o filenames -F _twinrate twinrate
)",
                     cases(app, ""));
}

}  // namespace

void add_pages_verb(CLI::App& app, int&) {
  CLI::App* verb = app.add_subcommand("pages", "Write man pages or the completion of a shell");
  verb->group("");
  auto directory = std::make_shared<std::string>();
  auto bash = std::make_shared<bool>(false);
  verb->add_option("--man", *directory, "write the man pages into this directory");
  verb->add_flag("--bash-completion", *bash, "print the completion of bash");
  verb->callback([&app, directory, bash] {
    if (!directory->empty()) write_man_pages(app, "twinrate", *directory);
    if (*bash) fmt::print("{}", bash_completion(app));
  });
}

}  // namespace twinrate
