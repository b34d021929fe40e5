#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

// What files of /proc and /sys say: pure functions of their text. Empty where the text says nothing of it.

namespace twoport::doctor {

/// Parts that are not empty: between characters of `between`, white space, and ends of lines.
std::vector<std::string_view> split(std::string_view text, std::string_view between);
std::vector<std::string_view> words(std::string_view text);
std::vector<std::string_view> lines(std::string_view text);
std::optional<std::int64_t> whole_number(std::string_view text);

/// "0-2,5": processors.
std::vector<int> processor_list(std::string_view text);

enum class Preemption : std::uint8_t { real_time, full, voluntary, none, dynamic };
/// Of `uname -v`, /sys/kernel/realtime and /proc/cmdline. dynamic: it was built for a choice at boot, and none was made there.
std::optional<Preemption> preemption(std::string_view version, std::string_view realtime, std::string_view cmdline);

/// The value of a "NAME: value" or "NAME value" line.
std::optional<std::string_view> field(std::string_view text, std::string_view name);

/// Times of all processors since boot, of /proc/stat [clock ticks].
struct ProcessorTimes {
  std::int64_t total = 0, steal = 0;
};
std::optional<ProcessorTimes> processor_times(std::string_view stat);

/// "some … total=N" of /proc/pressure/cpu [us].
std::optional<std::int64_t> pressure_us(std::string_view pressure);

/// Interrupts of one processor by name, of /proc/interrupts; without the timer's and those that processors send to each other.
std::map<std::string, std::int64_t> device_interrupts(std::string_view interrupts, int processor);

/// Datagrams that found a full queue: RcvbufErrors of /proc/net/snmp.
std::optional<std::int64_t> udp_queue_errors(std::string_view snmp);

/// Packets that the kernel dropped or put off, all processors, of /proc/net/softnet_stat.
struct Softnet {
  std::int64_t dropped = 0, squeezed = 0;
};
std::optional<Softnet> softnet(std::string_view text);

/// cpu.max of a control group: share of one processor that it may use; empty: as much as it wants.
std::optional<double> cpu_quota(std::string_view cpu_max);
/// Path of the own group below /sys/fs/cgroup, of /proc/self/cgroup (version 2).
std::optional<std::string> cgroup_path(std::string_view self_cgroup);

/// Does /proc/cpuinfo name a hypervisor?
bool names_hypervisor(std::string_view cpuinfo);

/// Is a device of /proc/swaps in use?
bool swaps(std::string_view swaps);

/// The choice in brackets, as in "always [madvise] never".
std::optional<std::string_view> chosen(std::string_view choices);

}  // namespace twoport::doctor
