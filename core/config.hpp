// Reads a drive file (TOML) into DriveConfig, with overrides, and writes the resolved file back.
//
// Every problem is a BadInput with one line: file:line, the key, the problem and the allowed
// values. Unknown keys are errors. A drive file may start from a preset with `preset = "dilys2021"`
// and change some keys.
#pragma once
#include <functional>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "core/drive_config.hpp"

namespace twinrate {

// Bad input: the program prints what() and leaves with exit code 2.
struct BadInput : std::runtime_error {
  using std::runtime_error::runtime_error;
};

class Config {
 public:
  // `name_or_path`: a file, or the name of a preset (config/NAME.toml). `overrides`:
  // "key.path=value", the value in TOML syntax; a bare word counts as a string. Throws BadInput.
  static Config load(const std::string& name_or_path,
                     const std::vector<std::string>& overrides = {});
  static Config parse(const std::string& toml_text, const std::string& source_name,
                      const std::vector<std::string>& overrides = {});
  Config(Config&&) noexcept;
  Config& operator=(Config&&) noexcept;
  ~Config();

  const DriveConfig& drive() const;
  // Reads the table `path` ("estimator.ekf_sensorless"; absent counts as empty) through `fields`,
  // which may belong to a process folder. Unknown keys in it are errors. Reading it again replaces
  // its part of resolved().
  void read_table(const std::string& path, const std::function<void(FieldVisitor&)>& fields);
  // A table that a folder keeps as a struct: T::kTable is its name, T::fields lists its keys.
  template <class T>
  T read() {
    T table;
    read_table(T::kTable, [&](FieldVisitor& f) { table.fields(f); });
    return table;
  }
  // A number as given, independent of the owner of its table; empty if it was not given.
  std::optional<double> given_number(const std::string& key_path) const;
  bool has_table(const std::string& path) const;  // written in the file, its preset or an override
  // Call after every owner has read its tables: a table that nobody has read is an unknown key.
  void require_all_read() const;
  // The whole config with every default written out; parse() of it gives the same config. A table
  // that its owner has not read is written as it was given.
  std::string resolved() const;
  // The same with other effects.
  std::string resolved_with(std::vector<ConfiguredEffect> effects) const;
  // The same drive with further effects, a text of [[effect]] tables and nothing else, one of them
  // for the model at least. Tables of filters and controllers have to be read again. Throws
  // BadInput, naming `source`.
  Config with_effects(const std::string& effects_toml, const std::string& source) const;
  // The same drive without those effects of its model beyond the first `declared` that equal the
  // ones in the text. Throws BadInput if one of them is missing.
  Config without_effects(const std::string& effects_toml, const std::string& source,
                         std::size_t declared) const;
  // The same drive with its model from tick k on (known_from_s, known_to_s), as if the model never
  // changed. Throws BadInput if the result is no valid model.
  Config known_at(std::int64_t k) const;
  // The effects of a text of [[effect]] tables. Throws BadInput.
  static std::vector<ConfiguredEffect> effects_in(const std::string& effects_toml,
                                                  const std::string& source);
  // Throws BadInput if with_effects would throw for any drive.
  static void check_addition(const std::string& effects_toml, const std::string& source);
  // The keys as given, preset and overrides merged in.
  std::string merged() const;
  // Hash of every key as given: processes whose configs differ must not run together.
  std::int64_t fingerprint() const;
  // The place where a key was written, "file:line", for messages of cross checks.
  std::string where(const std::string& key_path) const;

  struct Impl;

 private:
  Config();
  std::unique_ptr<Impl> impl_;
};

// The directory of the presets: beside the source in a build tree, share/twinrate/config when
// installed.
std::string preset_directory();
std::vector<std::string> preset_names();

// One row of the reference page.
struct KeyRow {
  std::string key, range, default_value, meaning;
};
std::vector<KeyRow> describe_keys(const std::string& prefix,
                                  const std::function<void(FieldVisitor&)>& fields);
// A table of a drive file that another folder owns.
struct OwnedTable {
  std::string path;
  std::function<void(FieldVisitor&)> fields;
};
template <class T>
OwnedTable owned_table() {
  return {T::kTable, [table = T{}](FieldVisitor& f) mutable { table.fields(f); }};
}
// The keys of DriveConfig and of `owned`, in the order of the resolved file.
std::vector<KeyRow> describe_drive_keys(const std::vector<OwnedTable>& owned);

}  // namespace twinrate
