#include <gtest/gtest.h>

#include <cerrno>
#include <cmath>
#include <map>
#include <random>
#include <string>
#include <string_view>

#include "tools/doctor/examine.h"
#include "tools/doctor/link.h"
#include "tools/doctor/loop.h"
#include "tools/doctor/text.h"

namespace twoport::doctor::doctor_test {
namespace {

// ---- texts of /proc and /sys

TEST(DoctorText, ReadsLists) {
  EXPECT_EQ(processor_list("0-2,5\n"), (std::vector<int>{0, 1, 2, 5}));
  EXPECT_EQ(processor_list("\n"), std::vector<int>{});
  EXPECT_EQ(processor_list("1-x"), std::vector<int>{});
  EXPECT_EQ(whole_number(" -1\n"), -1);
  EXPECT_FALSE(whole_number("1x"));
  EXPECT_FALSE(whole_number(""));
  EXPECT_EQ(chosen("always [madvise] never\n"), "madvise");
}

TEST(DoctorText, TellsHowAKernelPreempts) {
  EXPECT_EQ(preemption("#1 SMP PREEMPT_RT Debian 6.1.76-1", "", ""), Preemption::real_time);
  EXPECT_EQ(preemption("#1 SMP PREEMPT_DYNAMIC", "1\n", ""), Preemption::real_time);
  EXPECT_EQ(preemption("#1 SMP PREEMPT_DYNAMIC Debian", "", "quiet preempt=full"), Preemption::full);
  EXPECT_EQ(preemption("#1 SMP PREEMPT_DYNAMIC Debian", "", "quiet preempt=none"), Preemption::none);
  EXPECT_EQ(preemption("#1 SMP PREEMPT_DYNAMIC @0", "", "quiet"), Preemption::dynamic);
  EXPECT_EQ(preemption("#1 SMP Debian", "", ""), Preemption::voluntary);
  EXPECT_FALSE(preemption("", "", ""));
}

TEST(DoctorText, FindsFieldsByTheirWholeName) {
  EXPECT_EQ(field("VmLckX:\t1 kB\nVmLck:\t 0 kB\n", "VmLck"), "0 kB");
  EXPECT_EQ(field("nr_periods 5\nnr_throttled 3\n", "nr_throttled"), "3");
  EXPECT_FALSE(field("nr_periods 5\n", "nr_throttled"));
}

TEST(DoctorText, ReadsCounters) {
  const auto times = processor_times("cpu  10 20 30 40 50 60 70 80 5 5\ncpu0 1 2 3 4 5 6 7 8 0 0\n");
  ASSERT_TRUE(times);
  EXPECT_EQ(times->total, 360);  // guest times are part of the first two
  EXPECT_EQ(times->steal, 80);
  EXPECT_FALSE(processor_times("intr 1 2"));
  EXPECT_EQ(pressure_us("some avg10=0.00 avg60=0.00 avg300=0.00 total=1234\nfull avg10=0.00 total=9\n"), 1234);
  EXPECT_EQ(udp_queue_errors("Ip: A B\nIp: 1 2\nUdp: InDatagrams NoPorts RcvbufErrors\nUdp: 7 8 9\n"), 9);
  const auto net = softnet("015baade 00000002 00000010 0\n0135063b 00000001 00000000 0\n");
  ASSERT_TRUE(net);
  EXPECT_EQ(net->dropped, 3);
  EXPECT_EQ(net->squeezed, 16);
  EXPECT_DOUBLE_EQ(*cpu_quota("150000 100000\n"), 1.5);
  EXPECT_FALSE(cpu_quota("max 100000\n"));
  EXPECT_EQ(cgroup_path("9:cpu:/\n0::/user.slice\n"), "/user.slice");
}

TEST(DoctorText, CountsInterruptsOfDevicesOnOneProcessor) {
  const std::string text =
      "           CPU0       CPU1       \n"
      " 24:          1          5  IO-APIC   5-edge      eth0\n"
      " 31:          0       9550  PCI-MSIX-0000:00:01.0   3-edge      nvme0q1\n"
      "LOC:    1234567    7654321   Local timer interrupts\n";
  EXPECT_EQ(device_interrupts(text, 1), (std::map<std::string, std::int64_t>{{"24 eth0", 5}, {"31 nvme0q1", 9550}}));
  EXPECT_TRUE(device_interrupts(text, 7).empty());
}

/// Whatever the text, nothing but an answer or none.
TEST(DoctorText, SurvivesAnyBytes) {
  std::mt19937 draw{1};
  const std::string alphabet = "0123456789-,:. \n\tcpusomeUdp:total=[]max";
  for (int i = 0; i < 20000; ++i) {
    std::string text;
    for (auto n = draw() % 60; n > 0; --n) text += alphabet[draw() % alphabet.size()];
    const auto part_of_text = [&](std::string_view part) {
      return part.data() >= text.data() && part.data() + part.size() <= text.data() + text.size();
    };
    for (const int processor : processor_list(text)) EXPECT_GE(processor, 0) << text;
    for (const auto& part : {field(text, "cpu"), chosen(text)}) EXPECT_TRUE(!part || part_of_text(*part)) << text;
    EXPECT_TRUE(!cgroup_path(text) || text.find(*cgroup_path(text)) != text.npos) << text;
    EXPECT_TRUE(!cpu_quota(text) || !std::isnan(*cpu_quota(text))) << text;
    // Every number begins with a digit or a sign of the text.
    if (text.find_first_of("0123456789") == text.npos) {
      EXPECT_FALSE(processor_times(text) || pressure_us(text) || udp_queue_errors(text)) << text;
      EXPECT_TRUE(device_interrupts(text, 0).empty()) << text;
    }
    softnet(text);
    EXPECT_FALSE(names_hypervisor(text)) << text;
    EXPECT_NE(preemption(text, "", text), Preemption::real_time) << text;
  }
}

// ---- checks

struct MachineOf {
  std::map<std::string, std::string> files;
  Permissions may;
  Counters before, after;

  Finding of(const std::string& name) const {
    const ReadFile read = [this](const std::string& path) {
      const auto found = files.find(path);
      return found == files.end() ? std::nullopt : std::optional{found->second};
    };
    for (const Finding& each : examine(read, may, before, after))
      if (each.name == name) return each;
    ADD_FAILURE() << "no check " << name;
    return {};
  }
};

TEST(DoctorChecks, SayOfABareMachineThatNothingCanBeSeen) {
  const MachineOf nothing;
  for (const std::string name :
       {"idle states", "frequency governor", "kernel", "real-time throttling", "processor quota", "virtual machine",
        "clock source", "swap", "load", "temperature", "UDP queue", "interrupts"}) {
    const Finding f = nothing.of(name);
    EXPECT_EQ(f.grade, Grade::unseen) << name;
    EXPECT_EQ(f.says.find("cannot be seen here: "), 0u) << f.says;
    EXPECT_EQ(f.cure, "") << name;
  }
}

TEST(DoctorChecks, NameMissingPermissionsWithACure) {
  MachineOf m;
  EXPECT_EQ(m.of("real-time priority").grade, Grade::good);
  m.may.rt_errno = EPERM;
  m.may.lock_errno = ENOMEM;
  m.may.memory_lock_bytes = 8 << 20;
  m.may.latency_errno = EACCES;
  EXPECT_EQ(m.of("real-time priority").grade, Grade::bad);
  EXPECT_NE(m.of("real-time priority").cure.find("usermod -aG realtime"), std::string::npos);
  EXPECT_EQ(m.of("locked memory").grade, Grade::bad);
  EXPECT_NE(m.of("locked memory").says.find("8192 kB"), std::string::npos);
  EXPECT_EQ(m.of("idle latency").grade, Grade::notice);
  EXPECT_NE(m.of("idle latency").cure.find("udev"), std::string::npos);
  m.may.latency_errno = ENOENT;
  EXPECT_EQ(m.of("idle latency").grade, Grade::unseen);
}

TEST(DoctorChecks, LookAtTheDeepestIdleStateThatIsOn) {
  MachineOf m;
  const std::string cpu = "/sys/devices/system/cpu/";
  m.files = {{cpu + "cpuidle/current_driver", "intel_idle\n"}, {cpu + "cpu0/cpuidle/state0/latency", "0"},
             {cpu + "cpu0/cpuidle/state0/name", "POLL"},       {cpu + "cpu0/cpuidle/state1/latency", "2"},
             {cpu + "cpu0/cpuidle/state1/name", "C1"},         {cpu + "cpu0/cpuidle/state2/latency", "133"},
             {cpu + "cpu0/cpuidle/state2/name", "C6"},         {cpu + "cpu0/cpuidle/state2/disable", "0\n"}};
  EXPECT_EQ(m.of("idle states").says, "the deepest, C6, takes 133 us to leave; the programs keep cores out of it");
  EXPECT_EQ(m.of("idle states").grade, Grade::good);
  m.may.latency_errno = EACCES;
  EXPECT_EQ(m.of("idle states").grade, Grade::notice);
  m.files[cpu + "cpu0/cpuidle/state2/disable"] = "1\n";
  EXPECT_EQ(m.of("idle states").says, "the deepest, C1, takes 2 us to leave");
}

TEST(DoctorChecks, ReadGovernorClockSwapAndMachine) {
  MachineOf m;
  const std::string cpu = "/sys/devices/system/cpu/";
  m.files = {{cpu + "online", "0-1\n"},
             {cpu + "cpu0/cpufreq/scaling_governor", "performance\n"},
             {cpu + "cpu1/cpufreq/scaling_governor", "powersave\n"},
             {"/sys/devices/system/clocksource/clocksource0/current_clocksource", "hpet\n"},
             {"/proc/swaps", "Filename Type\n/dev/sda2 partition\n"},
             {"/proc/cpuinfo", "processor : 0\nflags\t\t: fpu hypervisor sse\n"}};
  EXPECT_EQ(m.of("frequency governor").grade, Grade::notice);
  EXPECT_NE(m.of("frequency governor").cure.find("cpupower"), std::string::npos);
  m.files[cpu + "cpu1/cpufreq/scaling_governor"] = "performance";
  EXPECT_EQ(m.of("frequency governor").grade, Grade::good);
  EXPECT_EQ(m.of("clock source").grade, Grade::bad);
  EXPECT_EQ(m.of("swap").grade, Grade::good);  // memory is locked
  m.may.lock_errno = EPERM;
  EXPECT_EQ(m.of("swap").grade, Grade::notice);
  EXPECT_EQ(m.of("virtual machine").grade, Grade::notice);
}

TEST(DoctorChecks, CompareCountersBeforeAndAfter) {
  MachineOf m;
  m.files = {{"/proc/cpuinfo", "flags : fpu\n"}};
  m.before = {.steal_ticks = 10,
              .total_ticks = 1000,
              .pressure_us = 0,
              .udp_queue_errors = 5,
              .softnet_dropped = 0,
              .throttled_periods = {},
              .throttle_events = 3,
              .at_s = 1.0,
              .interrupts = {{"24 eth0 on processor 1", 100}}};
  m.after = m.before;
  m.after.at_s = 3.0;
  for (const std::string name : {"virtual machine", "load", "UDP queue", "temperature", "interrupts"})
    EXPECT_EQ(m.of(name).grade, Grade::good) << name;
  m.after.steal_ticks = 30;
  m.after.total_ticks = 1400;  // 5 %
  m.after.pressure_us = 1'000'000;
  m.after.udp_queue_errors = 6;
  m.after.throttle_events = 4;
  m.after.interrupts["24 eth0 on processor 1"] = 10100;
  EXPECT_EQ(m.of("virtual machine").grade, Grade::bad);
  EXPECT_NE(m.of("virtual machine").says.find("5.0 %"), std::string::npos);
  EXPECT_NE(m.of("load").says.find("50 %"), std::string::npos);
  EXPECT_EQ(m.of("load").grade, Grade::notice);  // with real-time priority it matters less
  m.may.rt_errno = EPERM;
  EXPECT_EQ(m.of("load").grade, Grade::bad);
  EXPECT_EQ(m.of("UDP queue").grade, Grade::notice);
  EXPECT_EQ(m.of("temperature").grade, Grade::bad);
  EXPECT_EQ(m.of("interrupts").says, "5000 a second by 24 eth0 on processor 1");
  EXPECT_NE(m.of("interrupts").cure.find("/proc/irq/24/"), std::string::npos);
}

// ---- the loop

TEST(DoctorLoop, IsGradedByItsOwnPeriod) {
  LoopFigures f;
  f.rate_hz = 1000.0;
  f.ticks = 2000;
  for (int i = 0; i < 2000; ++i) f.lateness.add(Duration{50'000});
  EXPECT_EQ(grade(f), Grade::good);
  f.skipped = 2;
  EXPECT_EQ(grade(f), Grade::notice);
  f.skipped = 3;
  EXPECT_EQ(grade(f), Grade::bad);
  f.skipped = 0;
  f.rate_hz = 4000.0;  // 50 us are a fifth of its period
  EXPECT_EQ(grade(f), Grade::notice);
  f.rate_hz = 6000.0;
  EXPECT_EQ(grade(f), Grade::bad);
}

TEST(DoctorLoop, IsMeasuredForAsLongAsAsked) {
  const LoopFigures f = measure_loop({.rate_hz = 500.0, .seconds = 0.2, .realtime = false, .spin = false});
  EXPECT_NEAR(static_cast<double>(f.ticks + f.skipped), 100.0, 20.0);  // a busy machine jumps over the last ticks
  EXPECT_EQ(f.late, f.preempted + f.waited + f.moved + f.faulted + f.unexplained);
  EXPECT_TRUE(f.not_permitted.empty());  // nothing was asked for
}

// ---- the link

TEST(DoctorLink, CountsEveryPacketOnce) {
  // 1 2 - - 5 4 4 6: 3 is lost, 4 is late and comes twice. Sent every millisecond, under way for 10 ms and more, by a clock that is 3 s
  // behind.
  const double arrivals_ms[][2] = {{1, 11}, {2, 12}, {5, 15.5}, {4, 16}, {4, 16.2}, {6, 30}, {7, 31}};
  std::vector<Arrival> arrivals;
  for (const auto& [sequence, at_ms] : arrivals_ms)
    arrivals.push_back({static_cast<std::uint64_t>(sequence), 1e-3 * sequence - 3.0, 1e-3 * (at_ms - sequence) + 3.0});
  const HeardWay heard = way_of(arrivals, 6, 3.0, -3.0);
  ASSERT_EQ(heard.packets.size(), 6U);  // the seventh was sent after the measurement
  EXPECT_TRUE(heard.packets[2].lost());
  EXPECT_NEAR(heard.packets[2].sent_s, 3e-3, 1e-9);
  EXPECT_NEAR(heard.packets[3].delay_s, 12e-3, 1e-9);
  const DirectionFigures f = heard.figures();
  EXPECT_EQ(f.received, 6);
  EXPECT_EQ(f.lost, 1);
  EXPECT_EQ(f.late, 1);
  EXPECT_EQ(f.duplicated, 1);
  EXPECT_NEAR(f.loss(), 1.0 / 6.0, 1e-12);
  EXPECT_NEAR(f.least_s, 10e-3, 1e-9);
  EXPECT_NEAR(f.jitter_max_s, 14e-3, 1e-9);
  EXPECT_NEAR(f.jitter_p50_s, 0.5e-3, 1e-9);
  EXPECT_NEAR(f.longest_gap_s, 14e-3, 1e-9);
}

TEST(DoctorLink, TellsTheClocksApartByTheFastestPackets) {
  const std::vector<Arrival> there{{1, 0.0, 7.02}, {2, 0.0, 7.05}}, back{{1, 0.0, -6.90}, {2, 0.0, -6.98}};
  EXPECT_NEAR(clocks_apart_s(there, back), 7.0, 1e-12);
}

}  // namespace
}  // namespace twoport::doctor::doctor_test
