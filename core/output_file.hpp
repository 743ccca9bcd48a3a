// Output files. No program overwrites a file that it did not make in the same run, except a file
// that the user names with --force.
#pragma once
#include <string>

namespace twinrate {

// True if something has this name; a dangling symbolic link counts.
bool name_is_taken(const std::string& path);

// Before the work begins: throws BadInput if `path` exists and `force` is false, or if it is not a
// plain file.
void expect_free(const std::string& path, bool force);

// Renames `from`; false, with errno set, if that fails or `to` exists.
bool rename_to_free_name(const std::string& from, const std::string& to);

// Creates an empty file. Throws BadInput if the name is taken or cannot be one,
// std::runtime_error if the disk is full.
void create_new(const std::string& path);

// Writes `text` to a new file. Throws as create_new(), and std::runtime_error if the disk is full;
// the file is then removed.
void write_new(const std::string& path, const std::string& text);

// A file under another name until finish(): PATH.part, or PATH.part-2 .. if that name is taken. The
// destructor removes an unfinished part file. Throws BadInput if it cannot be created.
class PartFile {
 public:
  explicit PartFile(const std::string& path);
  ~PartFile();
  PartFile(const PartFile&) = delete;
  PartFile& operator=(const PartFile&) = delete;
  const std::string& part_path() const { return part_path_; }
  // Renames the part file. A file that got the name since the constructor is not replaced: throws
  // BadInput.
  void finish();
  [[noreturn]] void fail() const;  // throws the write error in errno

 private:
  std::string path_, part_path_;
  bool replaces_, done_ = false;
};

// With --force: replaces the file by `text`. The old file remains until the new one is complete.
// Throws as PartFile.
void replace_file(const std::string& path, const std::string& text);

}  // namespace twinrate
