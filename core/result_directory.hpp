// The directory of a result, and the files that a verb may delete in it.
//
// A directory with results holds a record, `.twinrate.json`: the kind of each result and the files
// that were made for it. A verb writes only to names that are free. If a name is taken, the verb
// refuses the directory, unless --force is given and the record says that an earlier result of the
// same kind made the file. Only those files are removed.
//
//   ResultDirectory directory(path, ResultKind::kTrace, force);   refuses, deletes nothing
//   ..                                                            the work
//   directory.begin();                                            removes the earlier result
//   ..                                                            writes the files
//   directory.finish();                                           records the files
//
// A result that was begun and not finished (a killed run) is replaced in the same way: the names
// were free when it began, so the files with its names belong to it. A launched run that is still
// active is always refused: its drive would continue without a log.
#pragma once
#include <string>
#include <vector>

namespace twinrate {

enum class ResultKind { kRun, kTrace, kPlan, kSweep, kIdentify };

class ResultDirectory {
 public:
  // Creates the directory if it is missing. `resume`: continues the result, if there is one; the
  // caller compares its identity. Throws BadInput if the directory holds a result and `force` is false, if a name is taken
  // by a file that no result of this kind made, or if the directory cannot be written.
  ResultDirectory(std::string path, ResultKind kind, bool force, bool resume = false);
  // Removes the directory if this object created it and it is empty.
  ~ResultDirectory();
  ResultDirectory(const ResultDirectory&) = delete;
  ResultDirectory& operator=(const ResultDirectory&) = delete;

  const std::string& path() const { return path_; }
  // Removes the files of the earlier result, unless it is resumed. From here on the own names
  // belong to this result.
  void begin();
  // Records the files made. If a file of every finished result is missing, or the record cannot be
  // written (disk full), the result stays marked as begun.
  void finish();

 private:
  void expect_replaceable(bool force);

  std::string path_;
  ResultKind kind_;
  std::vector<std::string> replaced_;  // names of files of the earlier result
  bool resume_, made_ = false;
};

}  // namespace twinrate
