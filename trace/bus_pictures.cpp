#include "trace/bus_pictures.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace twinrate {
namespace {

TracePicture bus_picture() {
  TracePicture picture;
  picture.heading = "The bus voltage";
  picture.note =
      "v_dc as it was logged, less its mean over 0.1 s around each row, with and without what was "
      "found.";
  return picture;
}

}  // namespace

TracePicture picture_of_period(double f, const std::vector<double>& t,
                               const std::vector<char>& held_out,
                               const std::vector<BusPiece>& shown, const std::vector<double>& line,
                               const std::vector<double>& rest) {
  constexpr std::size_t kParts = 48;
  struct Mean {
    double before = 0, after = 0, rows = 0;
  };
  std::vector<Mean> means[2] = {std::vector<Mean>(kParts), std::vector<Mean>(kParts)};
  for (const BusPiece& run : shown)
    for (std::size_t k = run.first; k < run.last; ++k) {
      const double turns = f * t[k];
      const auto part = static_cast<std::size_t>(kParts * (turns - std::floor(turns)));
      Mean& m = means[held_out[k] != 0][std::min(part, kParts - 1)];
      m.before += rest[k] + line[k], m.after += rest[k], ++m.rows;
    }
  TracePicture picture = bus_picture();
  picture.title = fmt::format("v_dc over one period of {:.6g} Hz, means", f);
  picture.x_label = "time in the period (ms)";
  picture.y_label = "v_dc less its slow part (V)";
  for (std::size_t part = 0; part < kParts; ++part)
    for (const int held : {0, 1}) {
      const Mean& m = means[held][part];
      if (m.rows == 0) continue;
      picture.x.push_back(1e3 * (static_cast<double>(part) + 0.5) / kParts / f);
      picture.before.push_back(m.before / m.rows);
      picture.after.push_back(m.after / m.rows);
      picture.held_out.push_back(static_cast<char>(held));
    }
  return picture;
}

TracePicture picture_of_spectra(double highest_Hz, const BusSpectrum& before,
                                const BusSpectrum& after) {
  TracePicture picture = bus_picture();
  picture.title = "Spectrum of v_dc";
  picture.x_label = "frequency (Hz)";
  picture.y_label = "amplitude of a sine (V)";
  for (std::size_t b = 1; b < before.power.size(); ++b) {
    if (before.df * static_cast<double>(b) > highest_Hz) break;
    picture.x.push_back(before.df * static_cast<double>(b));
    picture.before.push_back(before.amplitude(b));
    picture.after.push_back(after.amplitude(b));
    picture.held_out.push_back(0);
  }
  return picture;
}

}  // namespace twinrate
