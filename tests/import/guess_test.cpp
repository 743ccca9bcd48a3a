// Maps guessed from headers as real tools write them. A column that is understood wrongly is worse
// than one that is not understood.
#include "import/guess.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "core/config.hpp"
#include "import/drive_rows.hpp"
#include "model/frames.hpp"

namespace twinrate {
namespace {

namespace fs = std::filesystem;
constexpr double kRpm = kTwoPi / 60;

// A file with this header, and what a careful reader of its source takes from it.
struct RealHeader {
  const char* name;
  const char* source;
  std::string header;                    // all lines before the data
  std::string row;                       // the fields of a row; {} is the row number k
  std::map<std::string, double> scales;  // of the columns that header and values determine
  // Columns that a reader who knows the source could take, too; not understood is allowed.
  std::map<std::string, double> more = {};
};

std::vector<RealHeader> real_headers() {
  return {
      {"vesc",
       "vesc_tool Log CSV, github.com/acheronfail/float-view/issues/1",
       "ms_today;input_voltage;temp_mos_max;temp_mos_1;temp_mos_2;temp_mos_3;temp_motor;"
       "current_motor;current_in;d_axis_current;q_axis_current;erpm;duty_cycle;amp_hours_used;"
       "amp_hours_charged;watt_hours_used;watt_hours_charged;tachometer;tachometer_abs;"
       "encoder_position;fault_code;vesc_id;d_axis_voltage;q_axis_voltage;ms_today_setup;",
       "8006902{};55.3;24;0;0;0;26.9;0;0;0.125;2.371;1200;0.21;0.3098;0.0311;15.7764;1.7476;69465;"
       "106373;41.4;0;1;0.001;-0.002;80068946;",
       {{"t", 1e-3}, {"v_dc", 1}, {"temperature", 1}}},
      {"laas_speed",
       "LAAS-CNRS cogging bench, speed_test_old.csv",
       "Time, Position, Velocity, Reference Velocity, Iq, Function Activated",
       "0.0{}, 68.01454, 0.0, 6.28319, -0.01953, 1",
       {{"t", 1}, {"i_q", 1}},
       {{"theta_m", 1}, {"omega_m", 1}, {"omega_m_ref", 1}}},
      {"laas_current",
       "LAAS-CNRS cogging bench, acc_current.csv",
       "Time, Position, Velocity, Iq, Uq, Vsupply",
       "3.0{}, 22.78314, -149.10293, -0.11328, -2.83203, 0.47931",
       {{"t", 1}, {"i_q", 1}, {"u_q", 1}},
       {{"theta_m", 1}, {"omega_m", 1}}},
      {"gchen_slow",
       "gchen_odrive, slow2_*.csv",
       "t_s,pos_counts,iq_measured_A",
       "0.00{},8157.3447,-0.002868",
       {{"t", 1}, {"i_q", 1}}},
      {"gchen_map",
       "gchen_odrive, coggingmap_*.csv",
       "encoder_count,iq_A",
       "{},0.331172",
       {{"i_q", 1}}},
      {"pangu",
       "inverter_iv_pangu, phaseB_80V_294pts.csv",
       "i_b_A,u_b_cmd_V",
       "-0.7{}2202947,-5.21496409",
       {{"i_b", 1}, {"u_b", 1}}},
      {"motulator",
       "motulator_flux_map, baldor_400rpm_map.csv",
       "i_d_A,i_q_A,psi_d_Vs,psi_q_Vs",
       "-20,-2{},0.12407773,-1.3117042",
       {{"i_d", 1}, {"i_q", 1}, {"psi_d", 1}, {"psi_q", 1}}},
      {"moteus",
       "mjbots/moteus, utils plot_highrate.py: names of its channels",
       "time_s,servo_stats.velocity,servo_stats.d_A,servo_stats.q_A,servo_stats.cur1_A",
       "0.00{},1.5,0.01,0.25,0.3",
       {{"t", 1}, {"omega_m", kTwoPi}, {"i_d", 1}, {"i_q", 1}}},
      {"moteus_python",
       "a logger with the moteus Python library",
       "id,timestamp,position,velocity,torque,voltage,temperature,fault",
       "1,1700000000.0{},0.25,1.5,0.01,24.5,31,0",
       {},
       {{"t", 1}}},
      {"odrive",
       "odrive, interface of firmware 0.5: a logger with names of odrivetool",
       "time_s,axis0.motor.current_control.Iq_measured,axis0.encoder.pos_estimate,"
       "axis0.encoder.vel_estimate,vbus_voltage,ibus",
       "0.00{},0.31,1.25,2.5,24.1,0.2",
       {{"t", 1}, {"i_q", 1}, {"v_dc", 1}}},
      {"odrive6",
       "odrive, interface of firmware 0.6",
       "time_s,axis0.motor.foc.Iq_measured,axis0.motor.foc.Id_measured,"
       "axis0.pos_vel_mapper.pos_rel,axis0.pos_vel_mapper.vel,vbus_voltage",
       "0.00{},0.31,0.01,1.25,2.5,24.1",
       {{"t", 1}, {"i_q", 1}, {"i_d", 1}, {"theta_m", kTwoPi}, {"omega_m", kTwoPi}, {"v_dc", 1}}},
      {"simplefoc",
       "FOCMotor::monitor(), fields named by a reader of its frames",
       "target\tvoltage_q\tcurrent_q_mA\tvelocity\tshaft_angle",
       "5.0\t1.2{}\t125.5\t5.1\t{}.25",
       {{"u_q", 1}, {"i_q", 1e-3}, {"omega_m", 1}, {"theta_m", 1}}},
      {"picoscope",
       "PicoScope 6, two rows of header",
       "Time,Channel A,Channel B\n(ms),(V),(V)\n",
       "-0.{}0000058,4.82528200,4.80422400",
       {{"t", 1e-3}}},
      {"keysight",
       "Keysight InfiniiVision",
       "x-axis,1,2\nsecond,Volt,Volt",
       "-{}.000000E-03,+0.0E+00,-402.010E-06",
       {{"t", 1}}},
      {"saleae", "Saleae Logic 2", "Time [s],Channel 0,Channel 1", "0.00{},0,1", {{"t", 1}}},
      {"simulation",
       "a C simulation of a PMSM on GitHub",
       "time,ia,ib,ic,vthev_a,v_a,v_n,omega,torque,theta_elec,theta_mech",
       "0.0{},1.251,-0.625,-0.626,1.2,3.1,0.1,31.4,0.2,0.5,0.1",
       {{"t", 1}, {"i_a", 1}, {"i_b", 1}, {"i_c", 1}}},
      {"mpc",
       "a C++ simulation of a PMSM on GitHub",
       "time,ia,ib,ic,id,iq,id_reference,iq_reference,mechanical_speed,electrical_speed,"
       "mechanical_angle,electrical_angle,electromagnetic_torque,load_torque,dc_link_voltage,"
       "v_alpha,v_beta,v_d,v_q",
       "0.0{},1.251,-0.625,-0.626,0.125,2.125,0.001,2.001,100,400,0.1,0.4,0.3,0.2,48.5,1.25,2.5,"
       "0.5,1.5",
       {{"t", 1},
        {"i_a", 1},
        {"i_b", 1},
        {"i_c", 1},
        {"i_d", 1},
        {"i_q", 1},
        {"i_d_ref", 1},
        {"i_q_ref", 1},
        {"v_dc", 1},
        {"u_alpha", 1},
        {"u_beta", 1},
        {"u_d", 1},
        {"u_q", 1}}},
      {"speed_sheet",
       "a spread sheet of a speed step",
       "Time (s),Speed (rpm),Set point (rpm)",
       "0.{},420,1000",
       {{"t", 1}, {"omega_m", kRpm}},
       {{"omega_m_ref", kRpm}}},
      {"paderborn",
       "Electric Motor Temperature, Paderborn University (kaggle): no time",
       "ambient,coolant,u_d,u_q,motor_speed,torque,i_d,i_q,pm,stator_yoke,profile_id",
       "19.8,18.8,-0.4{},-0.3,0.002,0.187,0.0044,0.0003,24.5,18.3,17",
       {{"u_d", 1}, {"u_q", 1}, {"i_d", 1}, {"i_q", 1}},
       {{"torque", 1}}},
      {"servo",
       "a position servo's set: huggingface.co/datasets/Stocko/towerpro_sg90",
       "trajectory_id,time_step,position,current_mA,voltage_V,velocity,target_position",
       "0,0.00{},155.830078,12.4,8.296,0,50.097656",
       {},
       {{"t", 1}}}};
}

class GuessMap : public testing::Test {
 protected:
  void SetUp() override {
    directory_ = fs::temp_directory_path() / fmt::format("twinrate-guess-{}", getpid());
    fs::create_directories(directory_);
  }
  void TearDown() override { fs::remove_all(directory_); }
  std::string write(const std::string& header, const std::string& row, int rows = 300) const {
    std::string text = header + "\n";
    for (int k = 0; k < rows; ++k) {
      std::string line = row;
      for (std::size_t at; (at = line.find("{}")) != std::string::npos;)
        line.replace(at, 2, fmt::format("{:03}", k));
      text += line + "\n";
    }
    return write_text("log.csv", text);
  }
  std::string write_text(const std::string& name, const std::string& text) const {
    std::ofstream(directory_ / name) << text;
    return (directory_ / name).string();
  }
  static std::map<std::string, double> scales(const Guess& guess) {
    std::map<std::string, double> found;
    for (const GuessedColumn& c : guess.columns)
      if (!c.canonical.empty()) found[c.canonical] = c.scale;
    return found;
  }
  static std::string reason(const Guess& guess, const std::string& name) {
    for (const GuessedColumn& c : guess.columns)
      if (c.name == name) return c.canonical.empty() ? c.reason : "is " + c.canonical;
    return "no column " + name;
  }
  fs::path directory_;
};

TEST_F(GuessMap, OfTwentyRealHeadersNoneIsWrongAndEighteenAreWhole) {
  int whole = 0;
  const auto headers = real_headers();
  ASSERT_EQ(headers.size(), 20u);
  for (const RealHeader& real : headers) {
    const Guess guess = guess_map({.file = write(real.header, real.row)});
    const auto found = scales(guess);
    bool all = true;
    for (const auto& [name, scale] : real.scales) {
      all = all && found.count(name);
      if (!found.count(name)) fmt::print("{}: {} is not understood\n", real.name, name);
    }
    for (const auto& [name, scale] : found) {
      const bool known = real.scales.count(name) || real.more.count(name);
      ASSERT_TRUE(known) << real.name << ": " << name << " is wrong";
      const double right = real.scales.count(name) ? real.scales.at(name) : real.more.at(name);
      EXPECT_DOUBLE_EQ(scale, right) << real.name << ": " << name;
    }
    for (const GuessedColumn& c : guess.columns)
      EXPECT_NE(c.canonical.empty(), c.reason.empty()) << real.name << ": " << c.name;
    whole += all;
  }
  EXPECT_GE(whole, 18);
  fmt::print("{} of {} headers whole\n", whole, headers.size());
}

// The map is a map: what was understood is read, in SI.
TEST_F(GuessMap, TheMapReadsTheFileThatItWasGuessedFrom) {
  int read = 0;
  for (const RealHeader& real : real_headers()) {
    const std::string file = write(real.header, real.row);
    const Guess guess = guess_map({.file = file});
    const std::string map_file = write_text("map.toml", map_toml(guess, ""));
    const ImportMap map = read_import_map(map_file);
    if (!guess.has("t") || guess.columns.size() < 2) continue;
    if (scales(guess).size() < 2) continue;  // a time alone
    const DriveRows rows = read_drive_rows(file, &map, false);
    EXPECT_EQ(rows.size(), 300u) << real.name;
    ++read;
  }
  EXPECT_GE(read, 10);
}

// A time and canonical names in half of the columns: the header of a drive log with columns of others.
TEST_F(GuessMap, HalfOfTheColumnsMakeADriveLog) {
  const auto unit_of_i_q = [&](const std::string& header, const std::string& row) {
    for (const GuessedColumn& c : guess_map({.file = write(header, row)}).columns)
      if (c.name == "i_q") return c.unit_from;
    return std::string("no column");
  };
  const std::string si = "the name of a drive log, SI";
  EXPECT_EQ(unit_of_i_q("t,i_q,note,mark", "0.{},0.1,1,2"), si);
  EXPECT_NE(unit_of_i_q("t,i_q,note,mark,state", "0.{},0.1,1,2,3"), si);
}

TEST_F(GuessMap, DecimalCommasUnitsInBracketsAndLinesBeforeTheHeader) {
  const std::string file = write(
      "Messung vom 3. Mai\nPr\xc3\xbc"
      "fling: M4\n\nZeit [ms];Iq [mA];Drehzahl [1/min];U_ZK [V]",
      "0,{};125,5;1500,25;48,1");
  const Guess guess = guess_map({.file = file});
  EXPECT_EQ(guess.format.separator, ';');
  EXPECT_EQ(guess.format.decimal, ',');
  EXPECT_EQ(guess.format.skip, 3);
  EXPECT_EQ(scales(guess), (std::map<std::string, double>{
                               {"t", 1e-3}, {"i_q", 1e-3}, {"omega_m", kRpm}, {"v_dc", 1}}));
  const ImportMap map = read_import_map(write_text("map.toml", map_toml(guess, "")));
  const DriveRows rows = read_drive_rows(file, &map, false);
  EXPECT_NEAR(rows.t[7], 7e-6, 1e-15);
  EXPECT_NEAR(rows.at("i_q", 7), 0.1255, 1e-12);
  EXPECT_NEAR(rows.at("omega_m", 7), 1500.25 * kRpm, 1e-9);
}

TEST_F(GuessMap, AnAmbiguousUnitIsSaidAndLeftOut) {
  const Guess guess = guess_map(
      {.file = write("time_s,iq,speed [rad/s],theta [deg],f [Hz],omega_m [rad/s],I_A,I_B,erpm,id2",
                     "0.00{},1250,31.4,90,50,31.4,0.512,0.256,3000,7")});
  EXPECT_NE(reason(guess, "iq").find("A or mA?"), std::string::npos);
  EXPECT_NE(reason(guess, "speed [rad/s]").find("of the shaft or of the electrical angle?"),
            std::string::npos);
  EXPECT_NE(reason(guess, "theta [deg]").find("electrical"), std::string::npos);
  EXPECT_EQ(reason(guess, "omega_m [rad/s]"), "is omega_m");
  EXPECT_EQ(reason(guess, "I_A"), "is i_a") << "phase A, for I_B stands beside it";
  EXPECT_EQ(reason(guess, "I_B"), "is i_b");
  EXPECT_NE(reason(guess, "erpm").find("electrical"), std::string::npos);
  const Guess uvw = guess_map({.file = write("time_s,I_U,I_V,I_W", "0.00{},0.512,-0.206,-0.306")});
  EXPECT_EQ(reason(uvw, "I_V"), "is i_b") << "a current is in no volts";
  EXPECT_NE(map_toml(guess, "").find("# not understood: iq (column 2): A or mA?"),
            std::string::npos);
}

TEST_F(GuessMap, AnAmpereIsNoPhaseA) {
  const auto of = [&](const std::string& header) {
    return scales(guess_map({.file = write(header, "0.00{};0.512;-0.206;48.125")}));
  };
  EXPECT_EQ(of("Time s;Current A;Power W;Voltage V"), (std::map<std::string, double>{}));
  EXPECT_EQ(of("t_s;Motor Current A;Power;Phase Current V"),
            (std::map<std::string, double>{{"t", 1}}));
  EXPECT_EQ(of("t_s;Current A;Current B;Current C"),
            (std::map<std::string, double>{{"t", 1}, {"i_a", 1}, {"i_b", 1}, {"i_c", 1}}));
  EXPECT_EQ(of("Zeit [s];Strom Phase U [A];Strom Phase V [A];Zwischenkreisspannung [kV]"),
            (std::map<std::string, double>{{"t", 1}, {"i_a", 1}, {"i_b", 1}, {"v_dc", 1e3}}));
  EXPECT_EQ(
      of("Temps (s);Courant phase c (mA);Iq_act (A);Vitesse (tr/min)"),
      (std::map<std::string, double>{{"t", 1}, {"i_c", 1e-3}, {"i_q", 1}, {"omega_m", kRpm}}));
}

TEST_F(GuessMap, ASignOrAStarBesideANameIsNoPlainQuantity) {
  const Guess guess =
      guess_map({.file = write("t/s;-i_q [A];|i_d| [A];\xce\x94"
                               "Iq [A];Iq* [A];U_DC/V;n/min^-1;Strom U in A;10*id [A]",
                               "0.00{};1.512;2.5;0.1;1.5;48.1;600;1.25;3.25")});
  EXPECT_EQ(scales(guess),
            (std::map<std::string, double>{
                {"t", 1}, {"i_q_ref", 1}, {"v_dc", 1}, {"omega_m", kRpm}, {"i_a", 1}}));
  EXPECT_EQ(reason(guess, "-i_q [A]"), "the name contains more than a quantity");
}

// Written by programs of Windows: the degree sign is one byte.
TEST_F(GuessMap, AHeaderInLatin1GivesAMapThatReadsTheFile) {
  const std::string file = write(
      "Zeit (ms);Strom W (A);Pr\xfc"
      "fwinkel;Temperatur Wicklung (\xb0"
      "C);n_ist (1/min)",
      "{};1.512;2.5;41.3;600");
  const Guess guess = guess_map({.file = file});
  const ImportMap map = read_import_map(write_text("map.toml", map_toml(guess, "")));
  const DriveRows rows = read_drive_rows(file, &map, false);
  EXPECT_NEAR(rows.at("i_c", 3), 1.512, 1e-12);
  EXPECT_NEAR(rows.at("omega_m", 3), 600 * kRpm, 1e-9);
  EXPECT_EQ(reason(guess,
                   "Pr\xc3\xbc"
                   "fwinkel"),
            "no signal of a drive log by its name");
}

TEST_F(GuessMap, TwoColumnsOfOneMeaningAreBothLeftOut) {
  const Guess guess =
      guess_map({.file = write("time_s,iq_A,Iq_meas [A],v_dc", "0.00{},1.5,1.4,48.1")});
  EXPECT_EQ(reason(guess, "iq_A"), "columns 2, 3 all read as i_q");
  EXPECT_EQ(reason(guess, "Iq_meas [A]"), "columns 2, 3 all read as i_q");
  EXPECT_EQ(reason(guess, "v_dc"), "is v_dc");
}

// Its dq currents stand in the frame of its own observer.
TEST_F(GuessMap, AVescLogGivesNoPhaseCurrentsAndItsSpeedNeedsThePolePairs) {
  const RealHeader vesc = real_headers().front();
  const std::string file = write(vesc.header, vesc.row);
  const Guess plain = guess_map({.file = file});
  EXPECT_EQ(plain.tool, "vesc");
  EXPECT_NE(reason(plain, "q_axis_current").find("no phase quantity"), std::string::npos);
  EXPECT_NE(reason(plain, "erpm").find("--drive gives the pole pairs"), std::string::npos);
  const Guess with_drive = guess_map({.file = file, .tool = "vesc", .n_p = 7});
  EXPECT_DOUBLE_EQ(scales(with_drive).at("omega_m"), kRpm / 7);
  for (const char* name : {"i_a", "i_b", "i_c", "i_alpha", "i_beta", "i_d", "i_q"})
    EXPECT_FALSE(with_drive.has(name)) << name;
}

TEST_F(GuessMap, SimpleFocWritesMilliamperesButOnlyIfItWroteTheFile) {
  const std::string file =
      write("target\tvoltage_q\tcurrent_q\tvelocity\tangle", "5.0\t1.2{}\t125.5\t5.1\t{}.25");
  EXPECT_NE(reason(guess_map({.file = file}), "current_q").find("A or mA?"), std::string::npos);
  EXPECT_DOUBLE_EQ(scales(guess_map({.file = file, .tool = "simplefoc"})).at("i_q"), 1e-3);
  EXPECT_THROW(guess_map({.file = file, .tool = "odrive"}), BadInput);
  EXPECT_THROW(guess_map({.file = file, .tool = "matlab"}), BadInput);
  EXPECT_THROW(guess_map({.file = file, .tool = "elmo"}), BadInput);
}

TEST_F(GuessMap, AFileWithoutATableIsOneLine) {
  EXPECT_THROW(guess_map({.file = write_text("a.csv", "no table\nat all\n")}), BadInput);
  EXPECT_THROW(guess_map({.file = write_text("b.csv", "")}), BadInput);
  EXPECT_THROW(guess_map({.file = (directory_ / "none.csv").string()}), BadInput);
}

}  // namespace
}  // namespace twinrate
