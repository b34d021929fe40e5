#include "tools/doctor/examine.h"

#include <fmt/format.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <set>

#include "common/base/text.h"
#include "tools/doctor/text.h"

namespace twoport::doctor {
namespace {

// /etc/security/limits.d/twoport.conf and the udev rule of the package grant all three to the group realtime.
const std::string kJoin = "sudo groupadd -f realtime; sudo usermod -aG realtime $USER";
const std::string kLimits = kJoin +
                            "; printf '@realtime - rtprio 90\\n@realtime - memlock unlimited\\n' | sudo tee "
                            "/etc/security/limits.d/twoport.conf; then log in again";
const std::string kCpu = "/sys/devices/system/cpu/";

class Examination {
 public:
  Examination(const ReadFile& read, const Permissions& may, const Counters& before, const Counters& after)
      : read_{read}, may_{may}, before_{before}, after_{after} {}

  std::vector<Finding> all() {
    permissions();
    idle_states();
    frequency();
    preemption_model();
    throttling();
    cores();
    interrupts();
    quota();
    virtual_machine();
    clock();
    memory();
    pressure();
    thermal();
    network();
    return std::move(findings_);
  }

 private:
  void add(std::string name, Grade grade, std::string says, std::string cure = {}) {
    findings_.push_back({std::move(name), grade, std::move(says), std::move(cure)});
  }
  void either(std::string name, bool good, std::string says_good, Grade grade, std::string says, std::string cure) {
    if (good) return add(std::move(name), Grade::good, std::move(says_good));
    add(std::move(name), grade, std::move(says), std::move(cure));
  }
  void unseen(std::string name, const std::string& why) {
    add(std::move(name), Grade::unseen, "cannot be seen here: " + why);
  }
  std::optional<std::string> line(const std::string& path) const {
    const std::optional<std::string> text = read_(path);
    if (!text) return {};
    return std::string{trimmed(*text)};
  }
  /// cpu0, cpu1, …: of those that are online.
  std::vector<std::string> processors() const {
    std::vector<std::string> all;
    for (const int cpu : processor_list(read_(kCpu + "online").value_or("0")))
      all.push_back(fmt::format("{}cpu{}/", kCpu, cpu));
    return all;
  }
  static std::string reason(int error) { return std::strerror(error); }
  /// During the measurement; nothing where it cannot be seen.
  std::optional<std::int64_t> counted(std::optional<std::int64_t> Counters::*what) const {
    if (!(before_.*what) || !(after_.*what)) return {};
    return *(after_.*what) - *(before_.*what);
  }

  void permissions() {
    either(
        "real-time priority", may_.rt_errno == 0, "SCHED_FIFO 80 is permitted", Grade::bad,
        fmt::format("SCHED_FIFO 80 is not permitted ({}; the limit is {}): other programs delay a tick by milliseconds",
                    reason(may_.rt_errno), may_.rt_priority_limit),
        kLimits);
    either("locked memory", may_.lock_errno == 0, "memory can be locked", Grade::bad,
           fmt::format("memory cannot be locked ({}; the limit is {}): a page fault may delay a tick",
                       reason(may_.lock_errno),
                       may_.memory_lock_bytes < 0 ? "none" : fmt::format("{} kB", may_.memory_lock_bytes / 1024)),
           kLimits);
    if (may_.latency_errno == ENOENT)
      unseen("idle latency", "there is no /dev/cpu_dma_latency, as in most containers");
    else
      either("idle latency", may_.latency_errno == 0, "/dev/cpu_dma_latency can be held at 0 while a program runs",
             Grade::notice,
             fmt::format(
                 "/dev/cpu_dma_latency cannot be opened ({}): waking an idle core may take tens of microseconds longer",
                 reason(may_.latency_errno)),
             kJoin +
                 "; echo 'KERNEL==\"cpu_dma_latency\", GROUP=\"realtime\", MODE=\"0660\"' | sudo tee "
                 "/etc/udev/rules.d/60-twoport.rules; sudo udevadm trigger /dev/cpu_dma_latency");
    if (may_.timer_slack_ns < 0) return unseen("timer slack", "the kernel does not tell it");
    add("timer slack", Grade::good,
        fmt::format("{} us by default; the programs set it to 1 ns, and real-time threads have none",
                    may_.timer_slack_ns / 1000));
  }

  void idle_states() {
    const std::optional<std::string> driver = line(kCpu + "cpuidle/current_driver");
    if (!driver || *driver == "none") return unseen("idle states", "no cpuidle driver, as in most virtual machines");
    std::int64_t deepest = -1;
    std::string name;
    for (int state = 0; state < 16; ++state) {
      const std::string path = fmt::format("{}cpu0/cpuidle/state{}/", kCpu, state);
      const auto latency = whole_number(read_(path + "latency").value_or(""));
      if (!latency) break;
      if (line(path + "disable") == "1" || *latency <= deepest) continue;
      deepest = *latency;
      name = line(path + "name").value_or("?");
    }
    if (deepest < 0) return unseen("idle states", "cpu0 has none");
    if (deepest <= 20)
      return add("idle states", Grade::good, fmt::format("the deepest, {}, takes {} us to leave", name, deepest));
    // Held latency keeps cores out of them while a program runs.
    add("idle states", may_.latency_errno == 0 ? Grade::good : Grade::notice,
        fmt::format("the deepest, {}, takes {} us to leave{}", name, deepest,
                    may_.latency_errno == 0 ? "; the programs keep cores out of it" : ""),
        may_.latency_errno == 0 ? "" : "sudo cpupower idle-set -D 20");
  }

  void frequency() {
    std::set<std::string> governors, preferences;
    for (const std::string& cpu : processors()) {
      if (const auto governor = line(cpu + "cpufreq/scaling_governor")) governors.insert(*governor);
      if (const auto preference = line(cpu + "cpufreq/energy_performance_preference")) preferences.insert(*preference);
    }
    if (governors.empty()) return unseen("frequency governor", "no cpufreq driver, as in most virtual machines");
    const bool performance = governors == std::set<std::string>{"performance"};
    add("frequency governor", performance ? Grade::good : Grade::notice,
        fmt::format("{}{}", fmt::join(governors, ", "),
                    performance ? "" : ": the clock rises only some time after a tick began"),
        performance ? "" : "sudo cpupower frequency-set -g performance");
    if (!preferences.empty() && !performance)
      add("energy preference", Grade::notice, fmt::format("{}", fmt::join(preferences, ", ")),
          "echo performance | sudo tee /sys/devices/system/cpu/cpu*/cpufreq/energy_performance_preference");
  }

  void preemption_model() {
    const auto model =
        preemption(may_.kernel, read_("/sys/kernel/realtime").value_or(""), read_("/proc/cmdline").value_or(""));
    const std::string cure = "sudo apt-get install linux-image-rt-amd64; sudo reboot";
    if (!model) return unseen("kernel", "its version does not say how it preempts");
    if (*model == Preemption::real_time) return add("kernel", Grade::good, "PREEMPT_RT");
    add("kernel", Grade::notice,
        *model == Preemption::full ? "preempt=full, not PREEMPT_RT: single ticks may be late by a millisecond"
        : *model == Preemption::dynamic
            ? "not PREEMPT_RT; PREEMPT_DYNAMIC without preempt= at boot does not say how it preempts"
            : "it does not preempt its own code (not PREEMPT_RT): single ticks may be late by milliseconds",
        cure);
  }

  void throttling() {
    const auto runtime = whole_number(read_("/proc/sys/kernel/sched_rt_runtime_us").value_or(""));
    if (!runtime) return unseen("real-time throttling", "no /proc/sys/kernel/sched_rt_runtime_us");
    if (*runtime < 0) return add("real-time throttling", Grade::good, "off");
    add("real-time throttling", Grade::good,
        fmt::format("real-time threads may take {:.0f} % of a second; a loop that busy-waits 50 us a tick stays below",
                    static_cast<double>(*runtime) / 1e4));
  }

  void cores() {
    const auto isolated = processor_list(read_(kCpu + "isolated").value_or(""));
    const std::size_t count = processors().size();
    either("processors", may_.processors != 1,
           fmt::format(
               "{} of {}, {}", may_.processors, count,
               isolated.empty() ? std::string{"none isolated"} : fmt::format("isolated: {}", fmt::join(isolated, ","))),
           Grade::notice, "one: every other program and every interrupt delays a tick", {});
    if (const auto smt = line(kCpu + "smt/active"); smt == "1")
      add("hyper-threading", Grade::notice, "on: a busy sibling slows a tick down by up to half",
          "echo off | sudo tee /sys/devices/system/cpu/smt/control");
  }

  void interrupts() {
    if (after_.interrupts.empty()) return unseen("interrupts", "no /proc/interrupts");
    const double spent = after_.at_s - before_.at_s;
    double most = 0.0;
    std::string busiest;
    for (const auto& [name, count] : after_.interrupts) {
      const auto earlier = before_.interrupts.find(name);
      const double rate = static_cast<double>(count - (earlier == before_.interrupts.end() ? 0 : earlier->second)) /
                          std::max(spent, 1e-9);
      if (rate > most) most = rate, busiest = name;
    }
    either("interrupts", most < 2000.0, fmt::format("of devices, at most {:.0f} a second on one processor", most),
           Grade::notice, fmt::format("{:.0f} a second by {}", most, busiest),
           "echo OTHER | sudo tee /proc/irq/" + busiest.substr(0, busiest.find(' ')) +
               "/smp_affinity_list, with another processor's number");
  }

  void quota() {
    const auto group = cgroup_path(read_("/proc/self/cgroup").value_or(""));
    const auto text = group ? read_("/sys/fs/cgroup" + *group + "/cpu.max") : std::nullopt;
    const auto without_group = text ? text : read_("/sys/fs/cgroup/cpu.max");
    if (!without_group) return unseen("processor quota", "no cpu.max of a control group (version 2)");
    const auto share = cpu_quota(*without_group);
    if (!share) return add("processor quota", Grade::good, "none");
    const std::int64_t throttled = counted(&Counters::throttled_periods).value_or(0);
    add("processor quota", throttled > 0 ? Grade::bad : Grade::notice,
        fmt::format("{:.2f} processors; held back {} times during the measurement", *share, throttled),
        "run outside the container, or raise its limit (docker run --cpus)");
  }

  void virtual_machine() {
    const auto cpuinfo = read_("/proc/cpuinfo");
    if (!cpuinfo) return unseen("virtual machine", "no /proc/cpuinfo");
    const bool is_virtual = names_hypervisor(*cpuinfo);
    const std::int64_t steal = counted(&Counters::steal_ticks).value_or(0),
                       total = counted(&Counters::total_ticks).value_or(0);
    const double share = total > 0 ? 100.0 * static_cast<double>(steal) / static_cast<double>(total) : 0.0;
    if (steal > 0)
      add("virtual machine", share > 1.0 ? Grade::bad : Grade::notice,
          fmt::format("the host took {:.1f} % of the processor time away during the measurement", share),
          "run on the machine itself, or give the virtual machine processors of its own");
    else if (is_virtual)
      add("virtual machine", Grade::notice, "a hypervisor: its host may stop a processor for milliseconds",
          "run on the machine itself for the last microseconds");
    else
      add("virtual machine", Grade::good, "no hypervisor is named");
  }

  void clock() {
    const auto source = line("/sys/devices/system/clocksource/clocksource0/current_clocksource");
    if (!source) return unseen("clock source", "no /sys/devices/system/clocksource");
    const bool slow = *source == "hpet" || *source == "acpi_pm" || *source == "jiffies";
    add("clock source", slow ? Grade::bad : Grade::good,
        *source + (slow ? ": reading the time takes microseconds" : ""),
        slow ? "echo tsc | sudo tee /sys/devices/system/clocksource/clocksource0/current_clocksource" : "");
  }

  void memory() {
    const auto swap = read_("/proc/swaps");
    if (!swap) return unseen("swap", "no /proc/swaps");
    add("swap", swaps(*swap) && may_.lock_errno != 0 ? Grade::notice : Grade::good,
        swaps(*swap) ? (may_.lock_errno == 0 ? "on; the programs lock their memory" : "on, and memory cannot be locked")
                     : "off",
        swaps(*swap) && may_.lock_errno != 0 ? "sudo swapoff -a" : "");
    if (const auto huge = read_("/sys/kernel/mm/transparent_hugepage/enabled"); huge && chosen(*huge) == "always")
      add("huge pages", Grade::notice, "always: the kernel may stop a thread to assemble one",
          "echo madvise | sudo tee /sys/kernel/mm/transparent_hugepage/enabled");
  }

  void pressure() {
    const auto waited_us = counted(&Counters::pressure_us);
    if (!waited_us) return unseen("load", "no /proc/pressure/cpu");
    const double spent = after_.at_s - before_.at_s;
    const double share = spent > 0.0 ? 1e-4 * static_cast<double>(*waited_us) / spent : 0.0;
    const Grade grade = share > 20.0 ? (may_.rt_errno == 0 ? Grade::notice : Grade::bad) : Grade::good;
    add("load", grade,
        fmt::format("some program waited for a processor in {:.0f} % of the time{}", share,
                    grade == Grade::good ? "" : "; other programs are busy"),
        grade == Grade::good ? "" : "top -o %CPU");
  }

  void thermal() {
    const auto events = counted(&Counters::throttle_events);
    if (!events) return unseen("temperature", "no thermal_throttle counters");
    either("temperature", *events <= 0, "the processor was not slowed down", Grade::bad,
           fmt::format("the processor was slowed down {} times during the measurement", *events),
           "cool the machine; sensors");
  }

  void network() {
    if (const auto errors = counted(&Counters::udp_queue_errors)) {
      const auto room = whole_number(read_("/proc/sys/net/core/rmem_max").value_or(""));
      add("UDP queue", *errors > 0 ? Grade::notice : Grade::good,
          fmt::format("{} datagrams found a full queue during the measurement{}", *errors,
                      room ? fmt::format("; the largest queue is {} kB", *room / 1024) : ""),
          *errors > 0 ? "sudo sysctl net.core.rmem_max=4194304" : "");
    } else {
      unseen("UDP queue", "no /proc/net/snmp");
    }
    if (const auto dropped = counted(&Counters::softnet_dropped); dropped && *dropped > 0)
      add("network interrupts", Grade::notice,
          fmt::format("the kernel dropped {} packets before they were sorted", *dropped),
          "sudo sysctl net.core.netdev_max_backlog=5000");
  }

  const ReadFile& read_;
  const Permissions& may_;
  const Counters& before_;
  const Counters& after_;
  std::vector<Finding> findings_;
};

}  // namespace

std::string to_string(Grade grade) {
  constexpr const char* kNames[] = {"good", "notice", "bad", "unseen"};
  return kNames[static_cast<std::size_t>(grade)];
}

Counters read_counters(const ReadFile& read, double at_s) {
  Counters c;
  c.at_s = at_s;
  if (const auto times = processor_times(read("/proc/stat").value_or(""))) {
    c.steal_ticks = times->steal;
    c.total_ticks = times->total;
  }
  c.pressure_us = pressure_us(read("/proc/pressure/cpu").value_or(""));
  c.udp_queue_errors = udp_queue_errors(read("/proc/net/snmp").value_or(""));
  if (const auto net = softnet(read("/proc/net/softnet_stat").value_or(""))) c.softnet_dropped = net->dropped;
  const auto group = cgroup_path(read("/proc/self/cgroup").value_or(""));
  if (const auto stat = group ? read("/sys/fs/cgroup" + *group + "/cpu.stat") : std::nullopt)
    if (const auto throttled = field(*stat, "nr_throttled")) c.throttled_periods = whole_number(*throttled);
  const std::string interrupts = read("/proc/interrupts").value_or("");
  const std::vector<int> processors = processor_list(read(kCpu + "online").value_or(""));
  for (const int cpu : processors)
    for (const auto& [name, count] : device_interrupts(interrupts, cpu))
      c.interrupts[fmt::format("{} on processor {}", name, cpu)] = count;
  for (const int cpu : processors)
    if (const auto count =
            whole_number(read(fmt::format("{}cpu{}/thermal_throttle/core_throttle_count", kCpu, cpu)).value_or("")))
      c.throttle_events = c.throttle_events.value_or(0) + *count;
  return c;
}

std::vector<Finding> examine(const ReadFile& read, const Permissions& may, const Counters& before,
                             const Counters& after) {
  return Examination{read, may, before, after}.all();
}

}  // namespace twoport::doctor
