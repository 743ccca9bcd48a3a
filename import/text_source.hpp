// The text of a measured file, however it is stored: plain, gzipped, or the columns of a MATLAB file.
#pragma once
#include <cstdint>
#include <memory>
#include <string>

namespace twinrate {

class TextSource {
 public:
  virtual ~TextSource() = default;
  // At most `size` bytes; 0 at the end. Throws BadInput: the file cannot be unpacked.
  virtual int read(char* to, unsigned size) = 0;
  virtual void seek(std::int64_t byte) = 0;  // of the text
  virtual double share_read() const = 0;
  // At the end: a packed text stops in the middle.
  virtual bool cut_off() const = 0;
};

// A name that ends in .mat is a MATLAB file (mat_file.hpp), any other a plain or gzipped text. Throws
// BadInput: no such file, not readable.
std::unique_ptr<TextSource> open_text(const std::string& path);

}  // namespace twinrate
