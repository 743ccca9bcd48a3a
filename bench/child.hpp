// A program that a bench starts, and the bus that it gets.
#pragma once
#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <cstdio>
#include <string>
#include <vector>

namespace twinrate {

// Starts the program words[0] with these words. What it prints goes to the file `output`, its errors to
// the file `errors`, which may be the same; empty: to those of the bench.
inline pid_t start(std::vector<std::string> words, const std::string& output,
                   const std::string& errors = "") {
  std::vector<char*> argv;
  argv.reserve(words.size() + 1);
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);
  std::fflush(stdout);  // the child would print it again
  const pid_t pid = fork();
  if (pid != 0) return pid;
  const auto opened = [](const std::string& path) {
    return open(path.c_str(), O_CREAT | O_TRUNC | O_WRONLY, 0600);
  };
  if (dup2(opened(output), STDOUT_FILENO) < 0) _exit(127);
  if (!errors.empty() && dup2(errors == output ? STDOUT_FILENO : opened(errors), STDERR_FILENO) < 0)
    _exit(127);
  execv(argv[0], argv.data());
  _exit(127);
}

// A port of its own for each process: benches that run at once do not meet.
inline std::string url_of_this_process() {
  return fmt::format("udpm://239.255.76.67:{}?ttl=0", 20000 + getpid() % 20000);
}

}  // namespace twinrate
