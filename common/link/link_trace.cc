#include "common/link/link_trace.h"

#include <algorithm>
#include <array>
#include <iterator>
#include <limits>
#include <utility>

#include "common/base/check.h"
#include "common/base/fmt.h"
#include "common/base/text.h"

namespace twoport {
namespace {

constexpr double kLost = std::numeric_limits<double>::quiet_NaN();
constexpr std::uint64_t kMostSequence = std::uint64_t{1} << 53;
constexpr double kMostSent_s = 1e6, kMostDelay_ms = 1e6;
constexpr std::size_t kShown = 60;  // characters of a line that is refused

/// All of `text` as a number from 0 to `most`.
template <class Number>
bool read_number(std::string_view text, Number most, Number& number) {
  const std::optional<Number> read = number_from<Number>(text);
  number = read.value_or(Number{0});
  return read && number >= Number{0} && number <= most;
}

struct Row {
  TracedPacket packet;
  int line;
};

class Reader {
 public:
  explicit Reader(const std::string& name) : name_{name} {}

  LinkTrace read(std::string_view rest) {
    bool header = false;
    for (line_ = 1; !rest.empty(); ++line_) {
      const std::string_view line = take_line(rest);
      if (line.empty()) continue;
      if (std::exchange(header, true)) {
        add(line);
      } else if (line != kLinkTraceHeader) {
        fail(line_,
             fmt::format("\"{}\" is not the header; it must be {}, then a row for each packet, as twoport-lab doctor "
                         "--save writes them",
                         in_one_line(line.substr(0, kShown)), kLinkTraceHeader));
      }
    }
    return {.to_slave = in_order("to_slave", to_slave_), .to_master = in_order("to_master", to_master_)};
  }

 private:
  [[noreturn]] void fail(int line, const std::string& words) const {
    throw ConfigError{fmt::format("{}:{}: {}", name_, line, words)};
  }

  void add(std::string_view line) {
    const auto fields = std::count(line.begin(), line.end(), ',') + 1;
    if (fields != 4) fail(line_, fmt::format("\"{}\" has {} fields; a row must be {}", line, fields, kLinkTraceHeader));
    std::array<std::string_view, 4> field;
    for (std::string_view rest = line; std::string_view & each : field) {
      const std::size_t comma = std::min(rest.find(','), rest.size());
      each = trimmed(rest.substr(0, comma));
      rest.remove_prefix(std::min(comma + 1, rest.size()));
    }
    if (field[0] != "to_slave" && field[0] != "to_master")
      fail(line_, fmt::format("direction is \"{}\"; it must be to_slave or to_master", field[0]));
    Row row{{0, 0.0, kLost}, line_};
    if (!read_number(field[1], kMostSequence, row.packet.sequence))
      fail(line_, fmt::format("sequence is \"{}\"; it must be a whole number from 0 on", field[1]));
    if (!read_number(field[2], kMostSent_s, row.packet.sent_s))
      fail(line_, fmt::format("sent_s is \"{}\"; it must be between 0 and {:.0f}", field[2], kMostSent_s));
    double ms = 0.0;
    if (!field[3].empty()) {
      if (!read_number(field[3], kMostDelay_ms, ms))
        fail(line_,
             fmt::format("delay_ms is \"{}\"; it must be between 0 and {:.0f}, or empty where the packet was lost",
                         field[3], kMostDelay_ms));
      row.packet.delay_s = 1e-3 * ms;
    }
    (field[0] == "to_slave" ? to_slave_ : to_master_).push_back(row);
  }

  TracedWay in_order(const char* direction, std::vector<Row>& rows) const {
    std::stable_sort(rows.begin(), rows.end(),
                     [](const Row& a, const Row& b) { return a.packet.sequence < b.packet.sequence; });
    TracedWay way;
    way.reserve(rows.size());
    for (std::size_t i = 0; i < rows.size(); ++i) {
      const auto& [packet, line] = rows[i];
      if (i > 0) {
        const auto& [before, line_before] = rows[i - 1];
        if (packet.sequence == before.sequence)
          fail(line, fmt::format("sequence {} of {} is in line {} too; each packet must have one row", packet.sequence,
                                 direction, line_before));
        if (packet.sequence != before.sequence + 1)
          fail(line, fmt::format("sequence {} of {} follows {}; none may be left out: a lost packet has a row with an "
                                 "empty delay_ms",
                                 packet.sequence, direction, before.sequence));
        if (packet.sent_s < before.sent_s)
          fail(line, fmt::format("sent_s of sequence {} of {} is {}; it must not be before {}, that of sequence {}",
                                 packet.sequence, direction, packet.sent_s, before.sent_s, before.sequence));
      }
      way.push_back(packet);
    }
    if (!way.empty() && std::all_of(way.begin(), way.end(), [](const TracedPacket& p) { return p.lost(); }))
      throw ConfigError{fmt::format("{}: every packet of {} is lost; at least one must arrive", name_, direction)};
    return way;
  }

  const std::string& name_;
  int line_ = 0;
  std::vector<Row> to_slave_, to_master_;
};

/// The delivered packets in the order of their arrival.
std::vector<std::size_t> by_arrival(const TracedWay& way) {
  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < way.size(); ++i)
    if (!way[i].lost()) order.push_back(i);
  const auto arrival = [&](std::size_t i) { return way[i].sent_s + way[i].delay_s; };
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return arrival(a) < arrival(b); });
  return order;
}

}  // namespace

bool is_link_trace(std::string_view text) {
  while (!text.empty())
    if (const std::string_view line = take_line(text); !line.empty()) return line.starts_with("direction");
  return false;
}

LinkTrace parse_link_trace(std::string_view text, const std::string& name) {
  return Reader{name}.read(text);
}

std::string to_csv(const LinkTrace& trace) {
  std::string text = fmt::format("{}\n", kLinkTraceHeader);
  for (const auto& [name, way] : {std::pair{"to_slave", &trace.to_slave}, {"to_master", &trace.to_master}})
    for (const TracedPacket& p : *way) {
      fmt::format_to(std::back_inserter(text), "{},{},{:.7f},", name, p.sequence, p.sent_s);
      if (!p.lost()) fmt::format_to(std::back_inserter(text), "{:.4f}", 1e3 * p.delay_s);
      text += '\n';
    }
  return text;
}

std::string why_no_delays(const std::vector<double>& ms) {
  constexpr std::size_t kFew = 100;
  constexpr double kLong_ms = 1000.0;
  const auto is_whole = [](double each) { return each == std::floor(each); };
  if (ms.size() < kFew || ms.back() < kLong_ms || !std::is_sorted(ms.begin(), ms.end()) ||
      !std::all_of(ms.begin(), ms.end(), is_whole))
    return {};
  return fmt::format(
      "{} whole numbers that never fall are times, as in a trace of mahimahi, and no delays; it must hold "
      "one delay in ms a line, or begin with {}",
      ms.size(), kLinkTraceHeader);
}

namespace {

/// The delays of each row as those of packets that are sent more often.
std::vector<double> of_sparse_rows(const std::vector<double>& rows, std::size_t packets, double rows_a_packet) {
  std::vector<double> nearest = rows;  // of a lost row that of the one before, or the first
  const auto first = std::find_if(rows.begin(), rows.end(), [](double each) { return !std::isnan(each); });
  double last = first == rows.end() ? kLost : *first, runs = 0.0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (std::isnan(rows[i]) && (i + 1 == rows.size() || !std::isnan(rows[i + 1]))) ++runs;
    if (!std::isnan(rows[i])) last = rows[i];
    nearest[i] = last;
  }
  const double share = runs / static_cast<double>(rows.size());
  constexpr double kGolden = 0.6180339887498949;  // its multiples are spread evenly
  double spread = 0.0;
  std::vector<double> all(packets);
  for (std::size_t k = 0; k < packets; ++k) {
    const std::size_t i =
        std::min(static_cast<std::size_t>(static_cast<double>(k) * rows_a_packet + 1e-6), rows.size() - 1);
    const bool in_outage = std::isnan(rows[i]) && i + 1 < rows.size() && std::isnan(rows[i + 1]);
    spread += spread < 1.0 - kGolden ? kGolden : kGolden - 1.0;
    all[k] = in_outage || spread < share ? kLost : nearest[i];
  }
  return all;
}

}  // namespace

std::vector<double> delays_at(const TracedWay& way, double rate_hz) {
  const double packets = static_cast<double>(way.size());
  // Mean time between two packets of the trace. With none, packet k is row k.
  const double period_s = way.size() > 1 ? (way.back().sent_s - way.front().sent_s) / (packets - 1.0) : 0.0;
  const double rows_a_packet = period_s > 0.0 ? 1.0 / (rate_hz * period_s) : 1.0;
  const bool same_rate = std::abs(rows_a_packet - 1.0) < 0.01;
  constexpr double kApart_s = 2e-9;  // of two arrivals, so that rounding to a nanosecond keeps their order
  std::vector<double> delay(way.size(), kLost);
  double arrival_s = -1.0;
  for (const std::size_t i : by_arrival(way)) {
    const double sent_s = static_cast<double>(i) * (same_rate ? 1.0 / rate_hz : period_s);
    arrival_s = std::max(arrival_s + kApart_s, sent_s + way[i].delay_s);
    delay[i] = arrival_s - sent_s;
  }
  if (same_rate) return delay;
  std::vector<double> at_rate(static_cast<std::size_t>(std::max(1.0, std::round(packets / rows_a_packet))));
  if (period_s > kSparse_s && rows_a_packet < 1.0) return of_sparse_rows(delay, at_rate.size(), rows_a_packet);
  for (std::size_t k = 0; k < at_rate.size(); ++k)
    at_rate[k] =
        delay[std::min(static_cast<std::size_t>(static_cast<double>(k) * rows_a_packet + 1e-6), way.size() - 1)];
  return at_rate;
}

DirectionFigures figures_of(const TracedWay& way) {
  DirectionFigures f;
  double losses_in_a_row = 0.0;
  for (std::size_t i = 0; i < way.size(); ++i) {
    if (!way[i].lost()) continue;
    ++f.lost;
    if (i == 0 || !way[i - 1].lost()) ++losses_in_a_row;
  }
  if (losses_in_a_row > 0.0) f.burst_packets = f.lost / losses_in_a_row;
  if (way.size() > 1) f.spacing_s = (way.back().sent_s - way.front().sent_s) / static_cast<double>(way.size() - 1);
  const std::vector<std::size_t> order = by_arrival(way);
  if (order.empty()) return f;
  f.received = static_cast<double>(order.size());
  std::vector<double> delays;
  for (std::size_t n = 0, newest = 0; n < order.size(); ++n) {
    const TracedPacket& p = way[order[n]];
    delays.push_back(p.delay_s);
    if (n > 0) {
      const TracedPacket& before = way[order[n - 1]];
      f.longest_gap_s = std::max(f.longest_gap_s, p.sent_s + p.delay_s - before.sent_s - before.delay_s);
      if (order[n] < newest) ++f.late;
    }
    newest = std::max(newest, order[n]);
  }
  std::sort(delays.begin(), delays.end());
  f.least_s = delays.front();
  const auto above_least = [&](double p) {
    const auto rank = static_cast<std::size_t>(std::ceil(p * f.received));
    return delays[std::max<std::size_t>(rank, 1) - 1] - f.least_s;
  };
  f.jitter_p50_s = above_least(0.5);
  f.jitter_p99_s = above_least(0.99);
  f.jitter_max_s = above_least(1.0);
  return f;
}

}  // namespace twoport
