#include "tools/doctor/text.h"

#include <algorithm>

#include "common/base/text.h"

namespace twoport::doctor {
namespace {

constexpr std::string_view kSpace = " \t\r\n";

bool is_number(std::string_view text) {
  return !text.empty() && text.find_first_not_of("0123456789") == text.npos;
}
std::optional<std::int64_t> number(std::string_view text, int base = 10) {
  return number_from<std::int64_t>(text, base);
}

}  // namespace

std::vector<std::string_view> split(std::string_view text, std::string_view between) {
  std::vector<std::string_view> all;
  for (std::size_t at = text.find_first_not_of(between); at != text.npos;) {
    const std::size_t end = std::min(text.find_first_of(between, at), text.size());
    all.push_back(text.substr(at, end - at));
    at = text.find_first_not_of(between, end);
  }
  return all;
}
std::vector<std::string_view> words(std::string_view text) {
  return split(text, kSpace);
}
std::vector<std::string_view> lines(std::string_view text) {
  return split(text, "\n");
}

std::optional<std::int64_t> whole_number(std::string_view text) {
  return number(trimmed(text));
}

std::vector<int> processor_list(std::string_view text) {
  std::vector<int> all;
  for (const std::string_view range : split(trimmed(text), ",")) {
    const std::size_t dash = range.find('-');
    const auto first = number(range.substr(0, dash));
    const auto last = dash == range.npos ? first : number(range.substr(dash + 1));
    if (!first || !last || *last - *first > 100000) return {};
    for (std::int64_t cpu = *first; cpu <= *last; ++cpu) all.push_back(static_cast<int>(cpu));
  }
  return all;
}

std::optional<Preemption> preemption(std::string_view version, std::string_view realtime, std::string_view cmdline) {
  if (trimmed(realtime) == "1" || version.find("PREEMPT_RT") != version.npos) return Preemption::real_time;
  for (const std::string_view word : words(cmdline)) {
    if (word == "preempt=full") return Preemption::full;
    if (word == "preempt=voluntary" || word == "preempt=lazy") return Preemption::voluntary;
    if (word == "preempt=none") return Preemption::none;
  }
  if (version.find("PREEMPT_DYNAMIC") != version.npos) return Preemption::dynamic;
  if (version.find("PREEMPT") != version.npos) return Preemption::full;
  if (version.find("SMP") != version.npos) return Preemption::voluntary;
  return {};
}

std::optional<std::string_view> field(std::string_view text, std::string_view name) {
  for (const std::string_view line : lines(text)) {
    if (!line.starts_with(name)) continue;
    if (line.size() > name.size() && kSpace.find(line[name.size()]) == kSpace.npos && line[name.size()] != ':')
      continue;  // a longer name
    std::string_view rest = trimmed(line.substr(name.size()));
    if (rest.starts_with(':')) rest = trimmed(rest.substr(1));
    return rest;
  }
  return {};
}

std::optional<ProcessorTimes> processor_times(std::string_view stat) {
  for (const std::string_view line : lines(stat)) {
    const std::vector<std::string_view> word = words(line);
    if (word.size() < 9 || word[0] != "cpu") continue;
    ProcessorTimes times;
    // user nice system idle iowait irq softirq steal; guest times are part of user and nice.
    for (std::size_t i = 1; i <= 8; ++i) {
      const auto value = number(word[i]);
      if (!value) return {};
      times.total += *value;
      if (i == 8) times.steal = *value;
    }
    return times;
  }
  return {};
}

std::optional<std::int64_t> pressure_us(std::string_view pressure) {
  for (const std::string_view line : lines(pressure)) {
    if (!line.starts_with("some ")) continue;
    const std::size_t total = line.find("total=");
    return total == line.npos ? std::nullopt : number(trimmed(line.substr(total + 6)));
  }
  return {};
}

std::map<std::string, std::int64_t> device_interrupts(std::string_view interrupts, int processor) {
  std::map<std::string, std::int64_t> all;
  std::size_t column = 0, processors = 0;
  for (const std::string_view line : lines(interrupts)) {
    const std::vector<std::string_view> word = words(line);
    if (column == 0) {
      processors = word.size();
      const auto found = std::find_if(word.begin(), word.end(), [&](std::string_view name) {
        return name.starts_with("CPU") && number(name.substr(3)) == processor;
      });
      if (found == word.end()) return {};
      column = static_cast<std::size_t>(found - word.begin()) + 1;
      continue;
    }
    // Numbered ones are of devices; the others have letters.
    if (word.size() <= column || !word[0].ends_with(':') || !is_number(word[0].substr(0, word[0].size() - 1))) continue;
    const auto count = number(word[column]);
    if (!count) continue;
    std::string name{word[0].substr(0, word[0].size() - 1)};
    if (word.size() > processors + 1) (name += ' ') += word.back();
    all[name] += *count;
  }
  return all;
}

std::optional<std::int64_t> udp_queue_errors(std::string_view snmp) {
  std::vector<std::string_view> names;
  for (const std::string_view line : lines(snmp)) {
    const std::vector<std::string_view> word = words(line);
    if (word.empty() || word[0] != "Udp:") continue;
    if (names.empty()) {
      names = word;
      continue;
    }
    const auto found = std::find(names.begin(), names.end(), "RcvbufErrors");
    const auto at = static_cast<std::size_t>(found - names.begin());
    return at < word.size() ? number(word[at]) : std::nullopt;
  }
  return {};
}

std::optional<Softnet> softnet(std::string_view text) {
  Softnet all;
  bool any = false;
  for (const std::string_view line : lines(text)) {
    const std::vector<std::string_view> word = words(line);
    if (word.size() < 3) continue;
    const auto dropped = number(word[1], 16), squeezed = number(word[2], 16);
    if (!dropped || !squeezed) return {};
    all.dropped += *dropped;
    all.squeezed += *squeezed;
    any = true;
  }
  return any ? std::optional{all} : std::nullopt;
}

std::optional<double> cpu_quota(std::string_view cpu_max) {
  const std::vector<std::string_view> word = words(cpu_max);
  if (word.size() != 2 || word[0] == "max") return {};
  const auto quota = number(word[0]), period = number(word[1]);
  if (!quota || !period || *period <= 0) return {};
  return static_cast<double>(*quota) / static_cast<double>(*period);
}

std::optional<std::string> cgroup_path(std::string_view self_cgroup) {
  for (const std::string_view line : lines(self_cgroup))
    if (line.starts_with("0::")) return std::string{trimmed(line.substr(3))};
  return {};
}

bool names_hypervisor(std::string_view cpuinfo) {
  const auto flags = field(cpuinfo, "flags");
  if (!flags) return false;
  const std::vector<std::string_view> all = words(*flags);
  return std::find(all.begin(), all.end(), "hypervisor") != all.end();
}

bool swaps(std::string_view swaps) {
  return lines(swaps).size() > 1;
}

std::optional<std::string_view> chosen(std::string_view choices) {
  const std::size_t open = choices.find('['), close = choices.find(']');
  if (open == choices.npos || close == choices.npos || close < open) return {};
  return choices.substr(open + 1, close - open - 1);
}

}  // namespace twoport::doctor
