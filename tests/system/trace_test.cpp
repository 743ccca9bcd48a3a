// The trace program: duties instead of voltages, and Ctrl-C at each stage.
#include <fmt/format.h>

#include <chrono>
#include <cmath>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "tests/system/run_program.hpp"
#include "tests/trace/synthetic_drive.hpp"

namespace twinrate::test {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

class Trace : public ProgramTest {
 protected:
  // The synthetic drive with 0.4 Ohm more than in its drive file. `duties`: instead of voltages.
  std::string log(const std::string& name, double seconds, bool duties) const {
    const RawLog raw = simulate_synthetic({.duration_s = seconds, .seed = 11, .R_extra = 0.4});
    std::string text = "t,i_a,i_b,i_c,theta_m,T_load,v_dc,";
    text += duties ? "duty_a,duty_b,duty_c\n" : "u_alpha,u_beta\n";
    for (std::size_t k = 0; k < raw.size(); ++k) {
      text +=
          fmt::format("{:.9g},{:.9g},{:.9g},{:.9g},{:.12g},{:.9g},{:.12g},", raw.t[k], raw.i_a[k],
                      raw.i_b[k], raw.i_c[k], raw.theta_m[k], raw.T_load[k], raw.v_dc[k]);
      const double u_b = -0.5 * raw.u_alpha[k] + std::sqrt(0.75) * raw.u_beta[k];
      const auto duty = [&](double u) { return 0.5 + u / raw.v_dc[k]; };
      text += duties ? fmt::format("{:.12g},{:.12g},{:.12g}\n", duty(raw.u_alpha[k]), duty(u_b),
                                   duty(-raw.u_alpha[k] - u_b))
                     : fmt::format("{:.12g},{:.12g}\n", raw.u_alpha[k], raw.u_beta[k]);
    }
    write_text(path(name), text);
    return path(name);
  }
  // `times`: number of equal files.
  std::vector<std::string> trace(const std::string& data, int times = 1) const {
    std::vector<std::string> list = {"twinrate", "trace",   plain_drive(), "--out", path("out"),
                                     "--json",   "--force", "--data",      data};
    for (int copy = 1; copy < times; ++copy) {
      list.push_back(fmt::format("{}-{}.csv", data, copy));
      fs::create_hard_link(data, list.back());
    }
    return list;
  }
  // The preset without its effects: the synthetic drive except for its resistance.
  std::string plain_drive() const {
    const std::string preset = read_text(TWINRATE_CONFIG "/niewiara2020.toml");
    write_text(path("drive.toml"), preset.substr(0, preset.find("[[effect]]")));
    return path("drive.toml");
  }
  // Sends Ctrl-C once the program has printed `progress`; `took_s`: time to its end.
  ProgramResult interrupted_at(const std::string& data, const std::string& progress, double& took_s,
                               int times = 1) const {
    Program run(trace(data, times));
    EXPECT_TRUE(wait_until([&] { return run.out().find(progress) != std::string::npos; }, 60))
        << run.out() << run.err();
    const auto then = std::chrono::steady_clock::now();
    run.signal(SIGINT);
    const ProgramResult result = run.wait(60);
    took_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - then).count();
    return result;
  }
  // The files of a trace interrupted during the selection.
  Json kept(const ProgramResult& result, double took_s) const {
    EXPECT_EQ(result.exit_code, 1);
    EXPECT_EQ(count_lines(result.err), 1) << result.err;
    EXPECT_NE(result.err.find("interrupted; "), std::string::npos) << result.err;
    EXPECT_LT(took_s, 20);
    const Json there = Json::parse(read_text(path("out/trace.json")));
    EXPECT_EQ(there["interrupted"], true);
    return there;
  }
};

TEST_F(Trace, DutiesAndTheVoltagesTheyMakeAreTracedAlike) {
  std::vector<Json> results;
  for (const bool duties : {false, true}) {
    const ProgramResult result = run_program(trace(log("log.csv", 2, duties)));
    ASSERT_EQ(result.exit_code, 0) << result.err;
    results.push_back(Json::parse(read_text(path("out/trace.json"))));
  }
  const Json &voltages = results[0]["effects"], &duties = results[1]["effects"];
  ASSERT_GE(voltages.size(), 1u);
  ASSERT_EQ(duties.size(), voltages.size());
  EXPECT_EQ(voltages[0]["kind"], "resistance");
  for (std::size_t i = 0; i < voltages.size(); ++i) {
    EXPECT_EQ(duties[i]["kind"], voltages[i]["kind"]);
    for (const auto& [name, parameter] : voltages[i]["parameters"].items()) {
      if (!parameter["value"].is_number()) continue;
      const double value = parameter["value"];
      EXPECT_NEAR(duties[i]["parameters"][name]["value"].get<double>(), value,
                  1e-5 * std::abs(value))
          << name;
    }
  }
  EXPECT_NEAR(voltages[0]["parameters"]["change"]["value"].get<double>(), 0.4, 0.02);
  EXPECT_EQ(results[1]["interrupted"], false);
}

TEST_F(Trace, AnExcludedKindIsNotNamedAndListedAsExcluded) {
  std::vector<std::string> words = trace(log("log.csv", 2, false));
  for (const char* word : {"--exclude", "resistance", "torsion,backlash", "--exclude", "cogging"})
    words.emplace_back(word);
  const ProgramResult result = run_program(words);
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const Json json = Json::parse(read_text(path("out/trace.json")));
  for (const Json& effect : json["effects"]) {
    EXPECT_NE(effect["kind"], "resistance");
    for (const Json& alias : effect["aliases"]) EXPECT_NE(alias, "resistance");
  }
  std::vector<std::string> excluded;
  for (const Json& row : json["not_identifiable"])
    if (row["why"] == "excluded by --exclude") excluded.push_back(row["kind"]);
  EXPECT_EQ(excluded, (std::vector<std::string>{"backlash", "cogging", "resistance", "torsion"}));
  EXPECT_EQ(read_text(path("out/extended.toml")).find("\"resistance\""), std::string::npos);
  EXPECT_NE(read_text(path("out/report.html")).find("not looked for"), std::string::npos);
  EXPECT_NE(json["verdict"], "nothing_missing") << json["sentence"];
}

TEST_F(Trace, InterruptedWhileReadingWritesNothingAndReportsIt) {
  std::string text = "t,i_a,i_b,u_alpha,u_beta,theta_m\n";
  for (int k = 0; k < 600'000; ++k) {
    text += std::to_string(k);
    text += "e-4,0.5,-0.25,10,5,1\n";
  }
  write_text(path("long.csv"), text);
  double took_s = 0;
  const ProgramResult result = interrupted_at(path("long.csv"), "reading", took_s, 40);
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_NE(result.err.find("interrupted while reading, nothing written"), std::string::npos)
      << result.err;
  EXPECT_EQ(count_lines(result.err), 1);
  EXPECT_FALSE(fs::exists(path("out")));
  EXPECT_LT(took_s, 20) << "0.3 s on a machine of its own";
}

TEST_F(Trace, InterruptedBeforeTheFirstEffectWritesNothingAndReportsIt) {
  double took_s = 0;
  const ProgramResult result = interrupted_at(log("log.csv", 5, false), "equations:", took_s);
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_NE(result.err.find("nothing written"), std::string::npos) << result.err;
  EXPECT_FALSE(fs::exists(path("out")));
  EXPECT_LT(took_s, 20) << "0.3 s on a machine of its own";
}

TEST_F(Trace, InterruptedLaterKeepsItsResultsAndReportsThatTheyAreNotJudged) {
  double took_s = 0;
  const ProgramResult result = interrupted_at(log("log.csv", 3, false), "selection:", took_s);
  const Json there = kept(result, took_s);
  EXPECT_TRUE(there["sentence"].get<std::string>().starts_with("Interrupted after "));
  ASSERT_GE(there["effects"].size(), 1u);
  EXPECT_EQ(there["effects"][0]["kind"], "resistance");
  EXPECT_TRUE(there["effects"][0]["evidence"]["delta_bic"].is_null()) << "it was not judged";
  EXPECT_NE(read_text(path("out/report.html")).find("Interrupted after "), std::string::npos);
  EXPECT_EQ(twinrate({"check", path("out/extended.toml")}).exit_code, 0);
}

TEST_F(Trace, ARippleOfTheBusIsFoundAndThenCompensated) {
  const std::string effect =
      "effect=[{kind=\"dc_bus_ripple\",amplitude_V=6,frequency_Hz=287.3,phase_rad=0.8}]";
  const ProgramResult simulated =
      twinrate({"simulate", "niewiara2020", "--set", effect, "--set", "run.duration_s=4", "--set",
                "controller.angle_source=measured", "--set",
                "reference.speed_rpm=[[0, 200], [0.8, -400], [2, 500], [3, -100]]", "--run-dir",
                path("run")});
  ASSERT_EQ(simulated.exit_code, 0) << simulated.err;
  const ProgramResult exported =
      twinrate({"export", path("run"), "--format", "csv", "--out", path("log.csv")});
  ASSERT_EQ(exported.exit_code, 0) << exported.err;
  ProgramResult result = run_program(trace(path("log.csv")));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const Json found = Json::parse(read_text(path("out/trace.json")));
  ASSERT_EQ(found["effects"].size(), 1u) << found["sentence"];
  const Json& ripple = found["effects"][0];
  EXPECT_EQ(ripple["kind"], "dc_bus_ripple");
  for (const auto& [name, truth] :
       {std::pair{"amplitude", 6.0}, {"frequency", 287.3}, {"phase", 0.8}}) {
    const Json& p = ripple["parameters"][name];
    EXPECT_LT(std::abs(p["value"].get<double>() - truth), 3 * p["sigma"].get<double>()) << name;
    EXPECT_GT(p["sigma"].get<double>(), 0) << name;
  }
  EXPECT_GT(ripple["evidence"]["holdout_gain"].get<double>(), 0.99);
  EXPECT_LT(ripple["evidence"]["delta_bic"].get<double>(), -1000);
  EXPECT_EQ(found["error"]["by_equation"]["bus"]["unit"], "V");
  EXPECT_NE(read_text(path("out/report.html")).find("The bus voltage"), std::string::npos);

  fs::copy_file(path("out/extended.toml"), path("extended.toml"));
  const std::vector<std::string> again = {
      "trace", path("extended.toml"), "--data",  path("log.csv"),
      "--out", path("out"),           "--force", "--json"};
  std::ofstream(path("out/verify.json")) << "mine";  // the trace before made none
  EXPECT_EQ(twinrate(again).exit_code, 2);
  EXPECT_EQ(read_text(path("out/verify.json")), "mine");
  fs::remove(path("out/verify.json"));
  result = twinrate(again);
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(Json::parse(read_text(path("out/trace.json")))["verdict"], "nothing_missing");
  const std::string last = result.out.substr(result.out.rfind('\n', result.out.size() - 2) + 1);
  EXPECT_EQ(Json::parse(last)["verdict"], "nothing_missing") << last;
}

TEST_F(Trace, BadOptionsAreOneLineBeforeTheWorkStarts) {
  const std::string data = log("log.csv", 1, false), drive = plain_drive();
  write_text(path("file"), "");
  const auto refused = [&](std::vector<std::string> more) {
    more.insert(more.begin(), {"trace", drive});
    const ProgramResult result = twinrate(more);
    EXPECT_EQ(result.exit_code, 2) << result.out << result.err;
    EXPECT_EQ(count_lines(result.err), 1) << result.err;
    EXPECT_EQ(result.out, "");
    return result.err;
  };
  const auto says = [](const std::string& line, const char* what) {
    EXPECT_NE(line.find(what), std::string::npos) << line;
  };
  for (const std::string& out : {path("file"), path("file/x"), std::string("/proc/x")})
    says(refused({"--data", data, "--out", out}), "cannot be written");
  const std::string out = path("nothing");
  says(refused({"--out", out, "--data", data, path(".") + "/log.csv"}), "is given twice in --data");
  says(refused({"--out", out, "--data", data, "--holdout", data}), "in --data and in --holdout");
  says(refused({"--out", out, "--data", data, "--exclude", "cogging,coging"}),
       "--exclude coging: no such kind of effect; adc_clipping,");
  says(refused({"--out", out, "--data", data, "--kinds", "cogging"}), "--kinds requires --plan");
  says(refused({"--out", out, "--data", data, "--duration", "5s"}), "--duration requires --plan");
  says(refused({"--out", out, "--data", data, "--plan", "--verify"}), "--plan excludes --verify");
  says(refused({"--out", out, "--data", data, "--plan", "--holdout", "0.3"}),
       "--plan excludes --holdout");
  says(refused({"--out", out, "--data", data, "--verify", "--lcm-url", "udpm://bogus"}),
       "udpm://bogus");
  EXPECT_FALSE(fs::exists(out));
}

// A flux map with saturation, of 61 x 61 points.
std::string saturated_map() {
  std::string text = "i_d,i_q,psi_d,psi_q\n";
  for (int a = -30; a <= 30; ++a)
    for (int b = -30; b <= 30; ++b) {
      const double i_d = 0.2 * a, i_q = 0.2 * b;
      text += fmt::format("{:.6g},{:.6g},{:.9g},{:.9g}\n", i_d, i_q,
                          0.1 + 0.02 * i_d / (1 + std::abs(i_q) / 20),
                          0.05 * i_q / (1 + std::abs(i_q) / 4));
    }
  return text;
}

TEST_F(Trace, AnInterruptedFluxMapKeepsItsResultsOrReportsThatThereAreNone) {
  write_text(path("map.csv"), saturated_map());
  double took_s = 0;
  ProgramResult result = interrupted_at(path("map.csv"), "points", took_s);
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_NE(result.err.find("before the first effect was found, nothing written"),
            std::string::npos)
      << result.err;
  EXPECT_EQ(count_lines(result.err), 1);
  EXPECT_FALSE(fs::exists(path("out")));

  result = interrupted_at(path("map.csv"), "held-out error", took_s);
  const Json there = kept(result, took_s);
  EXPECT_TRUE(there["sentence"].get<std::string>().starts_with("Interrupted after 1 step"));
  EXPECT_EQ(twinrate({"check", path("out/extended.toml")}).exit_code, 0);
}

}  // namespace
}  // namespace twinrate::test
