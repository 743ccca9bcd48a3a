#include "core/output_file.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>

#include "core/config.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;

// False, with errno set, if the file cannot be created or exists.
bool create_exclusively(const std::string& path) {
  const int file = open(path.c_str(), O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC, 0666);
  if (file >= 0) close(file);
  return file >= 0;
}

}  // namespace

bool rename_to_free_name(const std::string& from, const std::string& to) {
  if (renameat2(AT_FDCWD, from.c_str(), AT_FDCWD, to.c_str(), RENAME_NOREPLACE) == 0) return true;
  if (errno != EINVAL && errno != ENOSYS) return false;
  // A file system without this kind of rename.
  if (name_is_taken(to)) {
    errno = EEXIST;
    return false;
  }
  return std::rename(from.c_str(), to.c_str()) == 0;
}

bool name_is_taken(const std::string& path) {
  std::error_code error;
  return fs::exists(fs::symlink_status(path, error));
}

void expect_free(const std::string& path, bool force) {
  if (!name_is_taken(path)) return;
  // A rename would replace a device or directory.
  if (!fs::is_regular_file(path))
    throw BadInput(fmt::format("{}: is not a plain file; give a file name", path));
  if (!force)
    throw BadInput(fmt::format("{}: exists; give another name, or --force to replace it", path));
}

void create_new(const std::string& path) {
  if (create_exclusively(path)) return;
  if (errno == EEXIST)
    throw BadInput(fmt::format("{}: exists and is not overwritten; give another directory", path));
  const std::string why = fmt::format("{}: cannot be written: {}", path, std::strerror(errno));
  if (errno == ENOSPC || errno == EDQUOT || errno == EIO) throw std::runtime_error(why);
  throw BadInput(why);  // another name can be written
}

void write_new(const std::string& path, const std::string& text) {
  create_new(path);
  std::ofstream file(path, std::ios::binary);
  file << text;
  file.close();
  if (file) return;
  std::remove(path.c_str());
  throw std::runtime_error(fmt::format("{}: cannot be written", path));
}

PartFile::PartFile(const std::string& path) : path_(path), replaces_(name_is_taken(path)) {
  if (replaces_) expect_free(path, true);
  part_path_ = path + ".part";
  for (int copy = 2; !create_exclusively(part_path_); ++copy) {
    if (errno != EEXIST)
      throw BadInput(fmt::format("{}: cannot be written: {}", path, std::strerror(errno)));
    part_path_ = fmt::format("{}.part-{}", path, copy);
  }
}

PartFile::~PartFile() {
  if (!done_) std::remove(part_path_.c_str());
}

void PartFile::finish() {
  done_ = replaces_ ? std::rename(part_path_.c_str(), path_.c_str()) == 0
                    : rename_to_free_name(part_path_, path_);
  if (done_) return;
  if (errno == EEXIST)
    throw BadInput(fmt::format("{}: was made by another program meanwhile; not replaced", path_));
  fail();
}

void replace_file(const std::string& path, const std::string& text) {
  PartFile part(path);
  std::ofstream file(part.part_path(), std::ios::binary);
  file << text;
  file.close();
  if (!file) part.fail();
  part.finish();
}

void PartFile::fail() const {
  throw std::runtime_error(fmt::format("{}: cannot be written: {}", path_, std::strerror(errno)));
}

}  // namespace twinrate
