#include <gtest/gtest.h>

#include <csignal>
#include <filesystem>
#include <fstream>
#include <string>

#include "tests/loopback/relay.h"
#include "tests/support/live.h"

// What the programs are told wrong, and how they say so.
namespace twoport::test::usage_test {
namespace {

/// It ends at once with status 2 and one sentence that has all the `parts`, and leaves nothing behind.
void expect_refused(Process process, const Words& parts) {
  EXPECT_EQ(process.wait(), exited(2)) << process.err();
  EXPECT_EQ(process.out(), "");
  EXPECT_EQ(count(process.err(), "\n"), 1) << process.err();
  for (const std::string& part : parts) EXPECT_NE(process.err().find(part), std::string::npos) << process.err();
}

TEST(Usage, NamesAFlagThatIsNoneOrThatIsMissing) {
  const Pair pair;
  expect_refused(pair.master("out", {"--bogus"}), {"twoport-master: ", "--bogus"});
  expect_refused(pair.slave("out", {"--peer", "127.0.0.1:1"}), {"twoport-slave: ", "--peer"});
  expect_refused(pair.slave("out", {"--trace", "xml"}), {"twoport-slave: ", "--trace", "xml", "none", "csv"});
  expect_refused(Process{{TWOPORT_MASTER}}, {"twoport-master: ", "--scene is missing", "twoport-master --help"});
}

TEST(Usage, NamesASceneThatCannotBeRead) {
  Pair pair;
  pair.scene = pair.at("missing.textproto");
  expect_refused(pair.master(), {"twoport-master: ", pair.scene, "No such file"});
  pair.scene = pair.at(".");
  expect_refused(pair.slave(), {"twoport-slave: ", pair.scene, "cannot be read"});
}

TEST(Usage, PlacesAMisspeltFieldByLineAndColumn) {
  const Pair pair{"dof: 1\nduration_s: 1\ndevice { mass_kg: 1  dampin_n_s_per_m: 0 }\n"};
  for (Process (Pair::*start)(const std::string&, const Words&, const Surroundings&) const :
       {&Pair::master, &Pair::slave})
    expect_refused((pair.*start)("out", {}, {}), {pair.scene + ":3:22: ", "dampin_n_s_per_m", "damping_n_s_per_m"});
}

TEST(Usage, SaysWhatAnEnumMayBe) {
  const Pair in_file{press(1, "POSITION_FROCE")};
  expect_refused(in_file.master(), {in_file.scene + ":13:17: ", "architecture", "POSITION_FROCE", "POSITION_FORCE"});
  const Pair good;
  expect_refused(good.slave("out", {"--set", "control.passivity.method=MAGIC"}),
                 {"control.passivity.method=MAGIC", "NONE", "CLASSIC", "FORCE_PROJECTED"});
}

TEST(Usage, NamesAnOverrideOfNothingAndAValueOutOfBounds) {
  const Pair pair;
  expect_refused(pair.master("out", {"--set", "device.colour=3"}), {"device.colour=3", "colour", "mass_kg"});
  expect_refused(pair.slave("out", {"--set", "to_slave.loss=1.5"}), {"to_slave.loss", "1.5", "between 0 and 1"});
}

TEST(Usage, NamesADurationThatIsNone) {
  const Pair pair;
  expect_refused(pair.master("out", {"--duration", "soon"}), {"duration_s=soon", "number"});
  expect_refused(pair.slave("out", {"--duration=-1"}), {"duration_s is -1", "> 0"});
}

TEST(Usage, RefusesASlaveOfARenderedEnvironment) {
  const Pair pair{press(1, "RENDER")};
  expect_refused(pair.slave(), {"twoport-slave: ", "RENDER"});
}

TEST(Usage, NamesAnAddressThatIsNone) {
  Pair pair;
  for (const std::string wrong : {"256.0.0.1", "::1", "127.0.0.1:", ""}) {
    pair.host = wrong;
    expect_refused(pair.master(), {"--peer", "'" + pair.address() + "'", "ADDR:PORT"});
    expect_refused(pair.slave(), {"--listen", "'" + pair.address() + "'", "ADDR:PORT"});
  }
  pair.host = "192.0.2.1";  // kept for documentation: nobody has it
  expect_refused(pair.slave(), {pair.address(), "without a key"});
  Process insecure = pair.slave("out", {"--insecure"});
  EXPECT_EQ(insecure.wait(), exited(2)) << insecure.err();
  EXPECT_NE(insecure.err().find("no interface"), std::string::npos) << insecure.err();
  pair.host = "127.0.0.1";
  pair.port = 0;
  expect_refused(pair.master(), {pair.address()});
}

TEST(Usage, TakesHostNames) {
  Pair pair{press(1)};
  pair.host = "localhost";
  Process slave = pair.listening_slave(), master = pair.master("master", {"--duration", "1"});
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  EXPECT_GT(pair.summary("master").steps(), 0u);
  pair.host = "no-such-host.invalid";
  expect_refused(pair.master("out"), {"--peer", "no-such-host.invalid", "cannot be looked up", "IP address"});
}

TEST(Usage, SaysThatAPortIsInUse) {
  const Pair pair;
  Process first = pair.listening_slave("first");
  expect_refused(pair.slave("second"), {pair.address(), "in use"});
  EXPECT_TRUE(first.running()) << first.err();
}

TEST(Usage, NamesAFolderThatCannotBeMade) {
  const Pair pair;
  expect_refused(pair.slave("scene.textproto/below"), {"--out", "scene.textproto/below", "cannot be created"});
}

/// A summary and a trace of a run before.
void leave_earlier(const Pair& pair, const std::string& out) {
  std::filesystem::create_directories(pair.at(out));
  for (const std::string name : {"/summary.json", "/trace.csv"}) std::ofstream{pair.at(out + name)} << "earlier";
}

TEST(Usage, ARefusedCommandKeepsEarlierResults) {
  Pair pair;
  const Socket taken{pair.port};
  leave_earlier(pair, "out");
  const auto expect_kept = [&](Process process) {
    EXPECT_EQ(process.wait(), exited(2)) << process.err();
    EXPECT_EQ(read_text(pair.at("out/summary.json")), "earlier") << process.err();
    EXPECT_EQ(read_text(pair.at("out/trace.csv")), "earlier") << process.err();
    EXPECT_FALSE(std::filesystem::exists(pair.at("out/trace.csv.partial"))) << process.err();
  };
  expect_kept(pair.slave("out"));  // the port is in use
  expect_kept(pair.master("out", {"--device", "none"}));
  expect_kept(pair.master("out", {"--key", pair.at("no-key")}));
  expect_kept(pair.slave("out", {"--robot", "none"}));
  expect_kept(pair.slave("out", {"--key", ""}));
  pair.host = "192.0.2.1";
  expect_kept(pair.slave("out"));
}

TEST(Usage, AnEmptyValueIsRefused) {
  const Pair pair;
  for (const char* option : {"--key", "--page", "--out", "--stream", "--device", "--peer", "--duration"})
    expect_refused(pair.master("out", {option, ""}),
                   {std::string{"twoport-master: "} + option + " is empty; give a value, or leave it out"});
  expect_refused(pair.master("out", {"--page="}), {"--page is empty; give a value, or leave it out"});
  expect_refused(pair.slave("out", {"--key", ""}), {"--key is empty; give a value, or leave it out"});
}

TEST(Usage, SaysWhatIsMissingOrUnknownAndWhereHelpIs) {
  const auto said = [](std::vector<std::string> words) {
    Process p{words};
    EXPECT_EQ(p.wait(), exited(2)) << p.err();
    return p.err();
  };
  EXPECT_EQ(said({TWOPORT_LAB}), "twoport-lab: a command is missing; see twoport-lab --help\n");
  EXPECT_EQ(said({TWOPORT_LAB, "swep"}),
            "twoport-lab: swep: there is no such command, the nearest is sweep; see twoport-lab --help\n");
  EXPECT_EQ(said({TWOPORT_LAB, "run"}),
            "twoport-lab: scene is missing: Scene file (.textproto), or the name of a scene of the project; see "
            "twoport-lab run --help\n");
  EXPECT_EQ(said({TWOPORT_LAB, "merge"}),
            "twoport-lab: folders is missing: The --out of each part; see twoport-lab merge --help\n");
  EXPECT_EQ(said({TWOPORT_LAB, "run", "demo", "--ot", "y"}),
            "twoport-lab: --ot: there is no such option, the nearest is --out; see twoport-lab run --help\n");
  EXPECT_EQ(said({TWOPORT_LAB, "run", "demo", "y"}),
            "twoport-lab: y: one argument too many; see twoport-lab run --help\n");
  EXPECT_EQ(said({TWOPORT_LAB, "run", "demo", "--out"}),
            "twoport-lab: --out: its value is missing; see twoport-lab run --help\n");
  EXPECT_EQ(said({TWOPORT_LAB, "run", "demo", "--out", "y", "--out", "z"}),
            "twoport-lab: --out: it is given more than once; see twoport-lab run --help\n");
  EXPECT_EQ(said({TWOPORT_LAB, "export", "x", "--csv", ""}),
            "twoport-lab: --csv is empty; give a value, or leave it out\n");
  EXPECT_EQ(said({TWOPORT_LAB, "recommend", "--delay-ms", "50ms", "--loss", "0", "--stiffness", "1"}),
            "twoport-lab: --delay-ms is 50ms; it must be a number\n");
  EXPECT_EQ(said({TWOPORT_LAB, "recommend", "--delay-ms", "50", "--loss", "5", "--stiffness", "1000"}),
            "twoport-lab: --loss is 5; it must be between 0 and 0.99, the probability of a loss: for 5 % write 0.05\n");
}

TEST(Usage, OneFolderIsForOneProgram) {
  const Pair pair;
  Process slave = pair.listening_slave("out");
  Process second = pair.master("out");
  EXPECT_EQ(second.wait(), exited(2)) << second.err();
  EXPECT_NE(second.err().find("--out " + pair.at("out") + ": another program writes there now"), std::string::npos)
      << second.err();
  Process lab = finished({TWOPORT_LAB, "run", pair.scene, "--out", pair.at("out")});
  EXPECT_EQ(lab.wait(), exited(2)) << lab.err();
  Process master = pair.master("master", {"--set", "duration_s=0.5"});
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
  EXPECT_EQ(pair.summary("out").side(), "slave");
}

TEST(Usage, ASummaryThatStdoutDoesNotTakeIsAFailure) {
  const Pair pair{press(1, "RENDER")};
  for (const std::string& command :
       {std::string{TWOPORT_MASTER} + " --no-realtime --scene", TWOPORT_LAB + std::string{" run"}}) {
    Process process = finished({"/bin/sh", "-c", command + " \"$0\" --set duration_s=0.1 >/dev/full", pair.scene});
    EXPECT_EQ(process.wait(), exited(1)) << process.err();
    EXPECT_NE(process.err().find("the summary cannot be written to stdout: No space left on device"), std::string::npos)
        << process.err();
  }
}

TEST(Usage, AProbeThatStdoutDoesNotTakeIsAFailure) {
  for (const std::string what : {"list", "probe sim", "--help"}) {
    Process process = finished({"/bin/sh", "-c", std::string{TWOPORT_DEVICE} + " " + what + " >/dev/full"});
    EXPECT_EQ(process.wait(), exited(1)) << what;
    EXPECT_NE(process.err().find("standard output: not all could be written"), std::string::npos) << process.err();
  }
}

TEST(Usage, HelpAndVersionAnswerOnStdout) {
  for (const std::string program : {TWOPORT_MASTER, TWOPORT_SLAVE, TWOPORT_LAB}) {
    Process help = finished({program, "--help"}), version = finished({program, "--version"});
    const std::string name = program.substr(program.rfind('/') + 1);
    EXPECT_EQ(help.wait(), exited(0));
    EXPECT_EQ(help.err(), "");
    EXPECT_EQ(help.out().find(name + ": "), 0u) << help.out();
    EXPECT_EQ(version.wait(), exited(0));
    EXPECT_EQ(version.err(), "");
    EXPECT_EQ(version.out().find(name + " "), 0u) << version.out();
  }
  for (const std::string flag : {"--scene", "--set", "--peer", "127.0.0.1:45000", "--out", "--trace", "--no-realtime"})
    EXPECT_NE(finished({TWOPORT_MASTER, "--help"}).out().find(flag), std::string::npos) << flag;
  EXPECT_NE(finished({TWOPORT_SLAVE, "--help"}).out().find("--listen"), std::string::npos);
}

// ---- two programs that do not fit

/// Without a key the slave alone names the difference; a master is told that there is one.
void expect_both_refuse(const Pair& pair, Process master, const Words& parts, bool key = false) {
  Process slave = pair.slave();
  EXPECT_EQ(master.wait(), exited(2)) << master.err();
  EXPECT_EQ(slave.wait(), exited(2)) << slave.err();
  for (const std::string& part : parts) {
    EXPECT_NE(master.err().find(key ? part : "the slave names the difference"), std::string::npos) << master.err();
    EXPECT_NE(slave.err().find(part), std::string::npos) << slave.err();
  }
}
/// It has written what it has recorded, and says that it was refused.
void expect_refused_summary(const Pair& pair, const std::string& out, const std::string& part) {
  const schema::Summary s = pair.summary(out);
  EXPECT_FALSE(s.stable()) << out;
  EXPECT_EQ(s.verdict().find("refused: "), 0u) << s.verdict();
  EXPECT_NE(s.verdict().find(part), std::string::npos) << s.verdict();
  EXPECT_EQ(pair.trace(out).rows(), s.steps()) << out;
}

TEST(Mismatch, OfScenesIsRefusedByBothAndNamedByTheSlave) {
  const Pair pair;
  expect_both_refuse(
      pair, pair.master("master", {"--set", "control.virtual_coupling.stiffness_n_per_m=900"}),
      {"master and slave run different scenes: they differ in control.virtual_coupling.stiffness_n_per_m; start both "
       "with the same scene"});
  expect_refused_summary(pair, "master", "the slave names the difference");
  expect_refused_summary(pair, "slave", "different scenes");
  const Pair several;
  expect_both_refuse(
      several,
      several.master("master", {"--set", "control.passivity.method=NONE", "--set", "control.force_scale=2", "--set",
                                "control.engage_s=3", "--set", "control.hold_after_s=0.5"}),
      {"differ in control.force_scale, control.passivity.method, control.engage_s and more; start"});
}
TEST(Mismatch, WithAKeyIsNamedByBoth) {
  Pair pair;
  pair.share_key();
  expect_both_refuse(
      pair, pair.master("master", {"--set", "control.virtual_coupling.stiffness_n_per_m=900"}),
      {"master and slave run different scenes: they differ in control.virtual_coupling.stiffness_n_per_m; start both "
       "with the same scene"},
      true);
}
TEST(Mismatch, LeavesNothingOfAnEarlierRun) {
  const Pair pair;
  for (const std::string side : {"master", "slave"}) leave_earlier(pair, side);
  expect_both_refuse(pair, pair.master("master", {"--trace", "none", "--set", "slave_rate_hz=500"}),
                     {"rate of the slave"});
  EXPECT_FALSE(std::filesystem::exists(pair.at("master/trace.csv")));
  expect_refused_summary(pair, "slave", "rate of the slave");
  EXPECT_FALSE(pair.summary("master").stable());
}
TEST(Mismatch, OfASlaveThatIsTakenIsTheSecondMastersAlone) {
  const Pair pair;
  const Words longer{"--set", "duration_s=60"};
  Process slave = pair.listening_slave("slave", longer), first = pair.master("first", longer);
  ASSERT_TRUE(first.says("paired with the slave")) << first.err();
  Process second = pair.master("second");
  EXPECT_EQ(second.wait(), exited(1)) << second.err();
  expect_refused_summary(pair, "second", "the slave is busy");
  for (Process* each : {&first, &slave}) {
    each->send(SIGINT);
    EXPECT_EQ(each->wait(), exited(0)) << each->err();
  }
}
TEST(Mismatch, OfDofIsRefusedByBothAndNamedByTheSlave) {
  const Pair pair;
  Pair three{press(3)};
  three.port = pair.port;
  expect_both_refuse(pair, three.master(), {"differ in dof: 3 at the master, 1 at the slave"});
}
TEST(Mismatch, OfRatesIsRefusedByBothAndNamedByTheSlave) {
  const Pair pair;
  expect_both_refuse(pair, pair.master("master", {"--set", "slave_rate_hz=500"}),
                     {"differ in the rate of the slave: it runs at 1000 Hz, the master expects 500 Hz"});
}
TEST(Mismatch, OfWhatEachSideModelsForItselfIsNone) {
  const Pair pair;
  Process slave = pair.listening_slave("slave", {"--set", "environment[0].wall.stiffness_n_per_m=2000"}),
          master = pair.master("master", {"--set", "duration_s=0.4", "--set", "operator.hand.stiffness_n_per_m=200"});
  EXPECT_EQ(master.wait(), exited(0)) << master.err();
  EXPECT_EQ(slave.wait(), exited(0)) << slave.err();
}

}  // namespace
}  // namespace twoport::test::usage_test
