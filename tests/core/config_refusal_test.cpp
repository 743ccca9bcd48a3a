// Every mistake is a BadInput of one line: place, key, allowed values.
#include <gtest/gtest.h>

#include <fstream>

#include "loop/load_drive.hpp"
#include "tests/core/drive_text.hpp"
#include "tests/support/drives.hpp"

namespace twinrate {
namespace {

using test::drive_text;

// The message, or "accepted".
template <class Load>
std::string refusal(const Load& load) {
  try {
    load();
  } catch (const BadInput& error) {
    return error.what();
  }
  return "accepted";
}

std::string refusal_of(const std::string& text, const std::vector<std::string>& overrides = {}) {
  return refusal([&] {
    Config config = test::parse(text, overrides);
    for (const OwnedTable& table : owned_tables()) config.read_table(table.path, table.fields);
    make_filter(config);
    make_controller(config);
    config.require_all_read();
  });
}

void expect_one_line_with(const std::string& message, const std::vector<std::string>& parts) {
  EXPECT_EQ(message.find('\n'), std::string::npos) << message;
  for (const std::string& part : parts)
    EXPECT_NE(message.find(part), std::string::npos) << "no \"" << part << "\" in: " << message;
}

// The drive file with one of its lines (counted from 1) replaced.
std::string with_line(int line, const std::string& replacement) {
  std::istringstream in(drive_text());
  std::string text, row;
  for (int i = 1; std::getline(in, row); ++i) text += (i == line ? replacement : row) + "\n";
  return text;
}

std::string endless_key(int dots) {
  std::string key = "a";
  for (int i = 0; i < dots; ++i) key += ".a";
  return key;
}

// The filter and controller need i_max; the text has no other change.
const std::string kFoc = "[controller.foc]\ni_max_A = 3.0\n";

TEST(Refusal, TheTextItselfIsAccepted) {
  EXPECT_EQ(refusal_of(drive_text() + kFoc), "accepted");
}

struct Mistake {
  const char* name;
  std::string text;
  std::vector<std::string> says;
};

void PrintTo(const Mistake& mistake, std::ostream* out) {
  *out << mistake.name;
}

const Mistake kMistakes[] = {
    {"UnknownKey",
     with_line(2, "R_s_Ohm = 1.2\nresistance = 3"),
     {"drive.toml:3", "machine.resistance", "unknown key", "R_s_Ohm"}},
    {"UnknownTable", drive_text() + "[motor]\nx = 1\n", {"drive.toml:15", "motor", "unknown"}},
    {"UnknownRootKey",
     "title = 'x'\n" + drive_text(),
     {"drive.toml:1", "title", "unknown key", "name"}},
    {"KeyOfTwoLines", "\"a\\nb\" = 1\n" + drive_text(), {"drive.toml:1", "unknown key"}},
    {"MissingKey", with_line(5, ""), {"drive.toml:1", "machine.psi_f_Wb", "missing key"}},
    {"MissingTable", with_line(9, "[plant]"), {"drive.toml", "v_dc_V"}},
    {"TextForANumber",
     with_line(2, "R_s_Ohm = 'low'"),
     {"drive.toml:2", "machine.R_s_Ohm", "a number from 0.0001 to 1000", "low"}},
    {"BooleanForANumber",
     with_line(2, "R_s_Ohm = true"),
     {"drive.toml:2", "machine.R_s_Ohm", "a number"}},
    {"FractionForAWholeNumber",
     with_line(6, "n_p = 4.5"),
     {"drive.toml:6", "machine.n_p", "a whole number from 1 to 200", "4.5"}},
    {"NumberTooLarge",
     with_line(2, "R_s_Ohm = 1e9"),
     {"drive.toml:2", "machine.R_s_Ohm", "out of range", "0.0001 to 1000"}},
    {"NumberTooSmall",
     with_line(7, "J_kgm2 = 0"),
     {"drive.toml:7", "machine.J_kgm2", "out of range"}},
    {"NegativeWholeNumber",
     with_line(6, "n_p = -4"),
     {"drive.toml:6", "machine.n_p", "from 1 to 200"}},
    {"NotANumber", with_line(2, "R_s_Ohm = nan"), {"drive.toml:2", "machine.R_s_Ohm"}},
    {"Infinite",
     with_line(2, "R_s_Ohm = inf"),
     {"drive.toml:2", "machine.R_s_Ohm", "out of range"}},
    {"DuplicateKey", with_line(3, "L_d_H = 0.5e-3\nL_d_H = 0.6e-3"), {"drive.toml:4", "L_d_H"}},
    {"DuplicateTable", drive_text() + "[rates]\nn = 2\n", {"drive.toml:15", "rates"}},
    {"BrokenToml", with_line(6, "n_p = = 4"), {"drive.toml:6"}},
    {"UnclosedText", with_line(1, "name = \"x"), {"drive.toml:1"}},
    {"NumberForATable", "rates = 5\n" + with_line(11, "[plant]"), {"drive.toml"}},
    {"RatioNotWhole",
     with_line(12, "f_s_Hz = 5000.0\nf_b_Hz = 1900.0"),
     {"drive.toml:13", "rates.f_b_Hz", "not a whole number", "2.63", "nearest"}},
    {"BackgroundFasterThanControl",
     with_line(12, "f_s_Hz = 5000.0\nf_b_Hz = 20000.0"),
     {"drive.toml:13", "rates.f_b_Hz"}},
    {"BothSpeeds",
     with_line(14, "omega_e_rad_s = 400.0\nspeed_rpm = 600"),
     {"drive.toml:15", "reference.speed_rpm", "not both"}},
    {"UnknownChoice",
     "start = 'push'\n" + drive_text(),
     {"drive.toml:1", "start", "aligned, align_if, flying", "push"}},
    {"UnknownPolicy",
     drive_text() + "[gain]\npolicy = 'late'\n",
     {"drive.toml:16", "gain.policy",
      "paper, immediate, extrapolate, rotate, rotor_frame, scheduled, propagated", "late"}},
    {"UnknownEstimator",
     drive_text() + "[estimator]\nkind = 'luenberger'\n",
     {"drive.toml:16", "estimator.kind", "ekf_sensorless", "luenberger"}},
    {"UnknownController",
     drive_text() + "[controller]\nkind = 'dtc'\n",
     {"drive.toml:16", "controller.kind", "foc", "dtc"}},
    {"TableOfAnotherKind",
     drive_text() + kFoc + "[estimator.sliding_mode]\nx = 1\n",
     {"drive.toml:17", "estimator.sliding_mode", "unknown"}},
    {"UnknownKeyOfThePlant",
     drive_text() + "[plant]\nsteps = 1\n",
     {"drive.toml:16", "plant.steps", "unknown key", "delay_samples, engine, erk_steps"}},
    {"UnknownEngine",
     drive_text() + "[plant]\nengine = 'euler'\n",
     {"drive.toml:16", "plant.engine", "one of rk, erk, cvode allowed", "euler"}},
    {"UnknownKeyOfTheBus",
     drive_text() + "[bus]\ntimeout_s = 1\n",
     {"drive.toml:16", "bus.timeout_s", "unknown key", "peer_timeout_s"}},
    {"UnknownKeyOfTheMonitor",
     drive_text() + "[monitor]\nauto = true\n",
     {"drive.toml:16", "monitor.auto", "unknown key", "auto_add, block_s, enabled"}},
    {"NumberForTheBus",
     "bus = 5\n" + drive_text(),
     {"drive.toml:1", "bus", "a table allowed, found 5"}},
    {"UnknownPreset", "preset = 'dilys1999'\n", {"drive.toml", "dilys1999", "dilys2021"}},
    {"PresetThatIsNoText", "preset = 5\n" + drive_text(), {"drive.toml:1", "preset"}},
    {"UnknownEffect",
     drive_text() + "[[effect]]\nkind = 'gremlins'\n",
     {"drive.toml:16", "effect[0]", "cogging, constant_load, coulomb_friction", "gremlins"}},
    {"EffectWithoutAKind",
     drive_text() + "[[effect]]\norder = 6\n",
     {"drive.toml:15", "effect[0]", "kind"}},
    {"EffectWithoutItsSize",
     drive_text() + "[[effect]]\nkind = 'cogging'\norder = 6\n",
     {"drive.toml:15", "effect[0].amplitude_Nm", "missing key"}},
    {"EffectWithAnUnknownKey",
     drive_text() + "[[effect]]\nkind = 'coulomb_friction'\ntorque_Nm = 1\nmood = 2\n",
     {"drive.toml:18", "effect[0].mood", "unknown key", "torque_Nm"}},
    {"SecondEffectOutOfRange",
     drive_text() + "[[effect]]\nkind = 'coulomb_friction'\ntorque_Nm = 1\n"
                    "[[effect]]\nkind = 'coulomb_friction'\ntorque_Nm = -1e5\n",
     {"drive.toml:20", "effect[1].torque_Nm", "out of range"}},
    {"EffectsAsOneTable",
     drive_text() + "[effect]\nkind = 'cogging'\n",
     {"drive.toml:15", "effect", "[[effect]]"}},
    {"ProfileTimesThatFall",
     with_line(14, "omega_e_rad_s = [[0, 1], [1, 2], [0.5, 3]]"),
     {"drive.toml:14", "reference.omega_e_rad_s", "times must rise"}},
    {"ProfileTimesThatRepeat",
     with_line(14, "omega_e_rad_s = [[0, 1], [0, 2]]"),
     {"drive.toml:14", "times must rise"}},
    {"ProfilePairOfThree",
     with_line(14, "omega_e_rad_s = [[0, 1, 2]]"),
     {"drive.toml:14", "reference.omega_e_rad_s", "[t_s, value]"}},
    {"ProfileOfText",
     with_line(14, "omega_e_rad_s = [[0, 'fast']]"),
     {"drive.toml:14", "a number"}},
    {"ProfileEmpty", with_line(14, "omega_e_rad_s = []"), {"drive.toml:14", "at least one"}},
    {"ProfileFlat", with_line(14, "omega_e_rad_s = [0, 1]"), {"drive.toml:14", "[t_s, value]"}},
    {"DiagonalTooShort",
     drive_text() + kFoc + "[estimator.ekf_sensorless]\nQ_diag = [1, 2, 3]\n",
     {"drive.toml:18", "estimator.ekf_sensorless.Q_diag", "4 numbers"}},
    {"NameWithALineEnd",
     "name = \"a\\nb\"\n" + drive_text(),
     {"drive.toml:1", "name", "of one line"}},
    {"NameWithAZeroByte",
     "name = \"a\\u0000b\"\n" + drive_text(),
     {"drive.toml:1", "name", "of one line"}},
    {"PresetWithAZeroByte",
     "preset = \"dilys2021\\u0000b\"\n" + drive_text(),
     {"dilys2021\\x00b", "no such preset"}},
    {"KeyWithoutEnd", drive_text() + endless_key(200'000) + " = 1\n", {"drive.toml:15", "dots"}},
    {"TableWithoutEnd", drive_text() + "[" + endless_key(200'000) + "]\n", {"drive.toml:15"}},
    {"InlineKeyWithoutEnd",
     drive_text() + "x = {a = \"\"\"b\"\"\"\"\", " + endless_key(200'000) + " = 1}\n",
     {"drive.toml:15", "dots"}},
    {"NestedUnknownKey",
     drive_text() + kFoc + "[controller.foc.startup]\nt_aling_s = 1\n",
     {"drive.toml:18", "controller.foc.startup.t_aling_s", "unknown key", "t_align_s"}},
};

class Mistakes : public testing::TestWithParam<Mistake> {};

TEST_P(Mistakes, AreOneLineWithPlaceKeyAndAllowedValues) {
  expect_one_line_with(refusal_of(GetParam().text), GetParam().says);
}

INSTANTIATE_TEST_SUITE_P(Refusal, Mistakes, testing::ValuesIn(kMistakes),
                         [](const auto& i) { return i.param.name; });

TEST(Refusal, DotsOfTextsAndCommentsAreNoKeys) {
  const std::string dots(100, '.');
  EXPECT_EQ(refusal_of("# \"" + dots + "\nname = \"\\\"" + dots + "\" # '" + dots + "\n" +
                       drive_text() + kFoc),
            "accepted");
}

TEST(Refusal, AMissingFileListsThePresets) {
  expect_one_line_with(refusal([] { Config::load("no/such/drive.toml"); }),
                       {"no/such/drive.toml", "dilys2021"});
}

TEST(Refusal, ADirectoryIsNamedAsOne) {
  expect_one_line_with(refusal([] { Config::load(".."); }),
                       {"..: is a directory", "name of a preset allowed"});
}

TEST(Refusal, RefusesASecondShaftOrFilterOnASignal) {
  const std::string drive = drive_text() + "[controller.foc]\ni_max_A = 5.0\n";
  const std::string shaft =
      "[[effect]]\nkind = 'torsion'\nJ_load_kgm2 = 4e-6\nstiffness_Nm_rad = 2\n";
  const std::string gap =
      "[[effect]]\nkind = 'backlash'\nJ_load_kgm2 = 4e-6\ngap_rad = 0.01\nstiffness_Nm_rad = 2\n";
  EXPECT_EQ(refusal_of(drive + shaft), "accepted");
  expect_one_line_with(refusal_of(drive + shaft + gap), {"effect", "backlash", "already"});
  EXPECT_EQ(refusal_of(drive + shaft + "used_in = 'plant'\n" + gap + "used_in = 'model'\n"),
            "accepted");
  const std::string filter =
      "[[effect]]\nkind = 'signal_lag'\nsignal = 'speed'\nform = 'first_order'\nlag_s = 1e-3\n";
  EXPECT_EQ(refusal_of(drive + filter), "accepted");
  expect_one_line_with(refusal_of(drive + filter + filter), {"effect", "one first_order"});
  expect_one_line_with(refusal_of(drive + "[[effect]]\nkind = 'torsion'\nJ_load_kgm2 = 1e-5\n"
                                          "stiffness_Nm_rad = 2\n"),
                       {"effect[0]", "J_load_kgm2", "no inertia"});
}

TEST(Refusal, AMistakeInAnOverrideIsReportedAtSet) {
  expect_one_line_with(refusal_of(drive_text(), {"machine.R_s_Ohm=-1"}),
                       {"--set", "machine.R_s_Ohm", "0.0001 to 1000"});
  expect_one_line_with(refusal_of(drive_text(), {"rates.m=4"}),
                       {"--set", "rates.m", "unknown key"});
  expect_one_line_with(refusal_of(drive_text(), {"rates.n"}),
                       {"--set", "rates.n", "key.path=value"});
  expect_one_line_with(refusal_of(drive_text(), {"=3"}), {"--set", "key.path=value"});
  expect_one_line_with(refusal_of(drive_text(), {"rates.n=two"}),
                       {"--set", "rates.n", "a whole number from 1 to 100000", "two"});
}

TEST(Refusal, AnOverrideOfATableThatIsMissingOrNoTableIsStillOneLine) {
  expect_one_line_with(refusal_of("name = 'x'\n", {"rates.n=4"}), {"missing key"});
  expect_one_line_with(refusal_of("rates = 5\n", {"rates.n=4"}), {"machine"});
  expect_one_line_with(refusal_of(drive_text(), {"machine=4"}), {"--set", "machine", "a table"});
}

TEST(Refusal, AMistakeInAPresetsKeyIsReportedInTheFileThatHasIt) {
  const std::string message =
      refusal_of("preset = 'dilys2021'\n[machine]\nR_s_Ohm = -3\n[rates]\nn = 2\n");
  expect_one_line_with(message, {"drive.toml:3", "machine.R_s_Ohm"});
}

TEST(Refusal, OfEffectsThatCannotBeginLater) {
  for (const char* effect : {"kind = \"torsion\"\nJ_load_kgm2 = 1e-6\nstiffness_Nm_rad = 1.0\n",
                             "kind = \"signal_lag\"\nsignal = \"current\"\nlag_s = 1e-4\n",
                             "kind = \"flux_linkage\"\nchange_Wb = -1e-4\n"})
    expect_one_line_with(refusal_of(drive_text() + kFoc + "[[effect]]\nfrom_s = 1.0\n" + effect),
                         {"from_s", "0 allowed"});
}

TEST(Refusal, OfAdditionsNamesTheirOwnLines) {
  const std::string torsion =
      "kind = \"torsion\"\nJ_load_kgm2 = 1e-6\nstiffness_Nm_rad = 1.0\nused_in = \"both\"\n";
  const Config config = test::parse(drive_text() + "[[effect]]\n" + torsion);
  expect_one_line_with(
      refusal([&] { config.with_effects("[bus]\npeer_timeout_s = 1.0\n", "request"); }),
      {"request:1", "bus", "only [[effect]] tables allowed"});
  expect_one_line_with(
      refusal([&] { config.with_effects("[[effect]]\nkind = \"magic\"\n", "request"); }),
      {"request:2: effect[0].kind", "magic"});
  const std::string add = "[[effect]]\nused_in = \"model\"\n";
  expect_one_line_with(refusal([&] {
                         config.with_effects(add + "kind = \"resistance\"\nchange_Ohm = -100.0\n",
                                             "request");
                       }),
                       {"request:1: effect[0]: resistance", "leaves no resistance"});
  expect_one_line_with(refusal([&] { config.with_effects("\n[[effect]]\n" + torsion, "request"); }),
                       {"request:2: effect", "the drive has a torsion or backlash already"});
  expect_one_line_with(refusal([&] {
                         config.with_effects(
                             "[[effect]]\nkind = \"resistance\"\nchange_Ohm = 0.1\n", "request");
                       }),
                       {"request: ", "used_in"});
}

}  // namespace
}  // namespace twinrate
