#include "drivers/inverse3.h"

#define BOOST_ASIO_NO_DEPRECATED
#define BOOST_BEAST_USE_STD_STRING_VIEW
#define BOOST_ASIO_DISABLE_FENCED_BLOCK  // the thread sanitizer does not support fences
#define BOOST_BIND_GLOBAL_PLACEHOLDERS   // the parser of JSON needs them
#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <boost/asio/buffer.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core/buffers_to_string.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/websocket.hpp>
#include <boost/property_tree/json_parser.hpp>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <sstream>
#include <thread>
#include <utility>

#include "common/base/check.h"
#include "common/base/text.h"
#include "common/base/thread.h"
#include "common/hardware/registry.h"
#include "drivers/newest.h"

namespace twoport {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
using asio::ip::tcp;
using boost::property_tree::ptree;
using Error = boost::system::error_code;
using Eigen::Vector3d;
using Now = std::chrono::steady_clock;
using namespace std::chrono_literals;

constexpr Duration kSilence = 100ms;         // without an answer, a reading or a command the force is zero
constexpr Duration kOpening = 2s;            // for each step of the first connection
constexpr Duration kRetry = 200ms;           // between two later ones
constexpr double kMostForce = 5.0;           // [N]
constexpr double kMostNumber = 100.0;        // [m], [m/s]
constexpr int kDeepest = 32;                 // nesting of a message: the parser recurses
constexpr std::size_t kLargest = 64 * 1024;  // message
constexpr int kMostMore = 16;                // messages beside an answer

bool is_shallow(const std::string& json) {
  int depth = 0;
  return std::all_of(json.begin(), json.end(), [&](char c) {
    depth += c == '{' || c == '[' ? 1 : c == '}' || c == ']' ? -1 : 0;
    return depth <= kDeepest;
  });
}

std::optional<Vector3d> vector_at(const ptree& device, const std::string& path) {
  Vector3d v;
  for (int i = 0; i < 3; ++i) {
    const auto number = number_from<double>(device.get(path + '.' + "xyz"[i], ""));
    if (!number || !(std::abs(*number) <= kMostNumber)) return {};
    v[i] = *number;
  }
  return v;
}

}  // namespace

std::optional<Inverse3State> read_inverse3(const std::string& message, const std::string& id) {
  if (!is_shallow(message)) return {};
  ptree all;
  try {
    std::istringstream text{message};
    read_json(text, all);
  } catch (const boost::property_tree::json_parser_error&) {
    return {};
  }
  const ptree devices = all.get_child("inverse3", {});
  for (const auto& [_, device] : devices) {
    const std::string name = device.get("device_id", "");
    const bool shown = std::all_of(name.begin(), name.end(), [](char c) { return c > ' ' && c < 0x7f; });
    if (name.empty() || !shown || (!id.empty() && name != id)) continue;
    const auto x = vector_at(device, "state.cursor_position"), v = vector_at(device, "state.cursor_velocity");
    if (!x || !v || device.get("status.calibrated", "true") != "true") return {};
    return Inverse3State{name, *x, *v};
  }
  return {};
}

std::string inverse3_command(const std::string& id, const Vector3d& push_n, bool first) {
  // The force is `vector` in the documents of 3.5, `values` in examples of 3.1; unknown keys are ignored.
  const std::string force = fmt::format(R"({{"x":{:.6f},"y":{:.6f},"z":{:.6f}}})", push_n.x(), push_n.y(), push_n.z());
  return fmt::format(
      R"({{{}"inverse3":[{{"device_id":{},"commands":{{"set_cursor_force":{{"vector":{},"values":{}}}}}}}]}})",
      first ? R"("session":{"configure":{"profile":{"name":"twoport"}}},)" : "", json_string(id), force, force);
}

namespace {

struct Reading {
  Vector3d x_m = Vector3d::Zero(), v_m_per_s = Vector3d::Zero(), push_n = Vector3d::Zero();
  bool fresh = false;  ///< position and velocity
};

/// The connection to the service, on a thread of its own: a command and its answer, twice a period of the control.
class Service {
 public:
  Service(const std::string& arguments, Seconds period)
      : where_{arguments.empty() ? "localhost:10001" : arguments},
        pause_{std::max(to_duration(0.5 * period.si()), Duration{250us})} {
    const std::string flag = "--device inverse3:" + where_ + ": ";
    const std::size_t colon = where_.rfind(':');
    const auto port = colon == where_.npos ? std::nullopt : number_from<std::uint16_t>(where_.substr(colon + 1));
    if (!port || colon == 0) throw ConfigError{flag + "ARGS is ADDRESS:PORT of the service, as localhost:10001"};
    const bool bracketed = where_.front() == '[' && where_[colon - 1] == ']';
    const std::string host = bracketed ? where_.substr(1, colon - 2) : where_.substr(0, colon);
    Error error;
    endpoints_ = tcp::resolver{context_}.resolve(host, std::to_string(*port), error);
    if (!error) error = connect(kOpening);
    if (error)
      throw ConfigError{flag + "the Haply Inverse Service does not answer (" + error.message() +
                        "); start it, or give its ADDRESS:PORT"};
    if (!stream_) throw ConfigError{flag + "no calibrated Inverse3 is there; connect one and calibrate it"};
    thread_ = std::thread{[this] { run(); }};
  }
  ~Service() {
    going_ = false;
    thread_.join();
  }

  [[nodiscard]] std::string name() const { return "Haply Inverse3 " + id_ + " at " + where_; }
  // Of the control step.
  bool take(Reading& reading) noexcept { return readings_.take(reading); }
  void push(const Vector3d& f) noexcept { commands_.put(f); }

 private:
  /// One operation of the stream, to its end or for `limit` at most.
  template <class Start>
  Error complete(Duration limit, Start start) {
    Error result;
    stream_->next_layer().expires_after(limit);
    start([&result](Error e, auto&&...) { result = e; });
    context_.restart();
    context_.run();
    return result;
  }
  Error read(Duration limit) {
    heard_.clear();
    return complete(limit, [&](auto done) { stream_->async_read(heard_, done); });
  }
  /// Without an error and without a stream: the device is not there.
  Error connect(Duration limit) {
    stream_.emplace(context_);
    stream_->read_message_max(kLargest);
    Error error = complete(limit, [&](auto done) { stream_->next_layer().async_connect(endpoints_, done); });
    if (!error) stream_->next_layer().socket().set_option(tcp::no_delay{true}, error);
    if (!error) error = complete(limit, [&](auto done) { stream_->async_handshake(where_, "/", done); });
    if (!error) error = read(limit);  // the service speaks first
    first_ = true;
    if (error || !pass_on(Vector3d::Zero())) stream_.reset();
    return error;
  }
  /// Passes on what has been heard, with the push that was held until then. From now on `push` is.
  bool pass_on(const Vector3d& push) {
    const auto state = read_inverse3(beast::buffers_to_string(heard_.data()), id_);
    if (state) {
      if (id_.empty()) id_ = state->id;  // before there is a thread
      reading_.x_m = state->x_m;
      reading_.v_m_per_s = state->v_m_per_s;
      read_at_ = Now::now();
    }
    tell(std::exchange(held_, push), state.has_value());
    return state.has_value();
  }
  void tell(const Vector3d& held, bool fresh) {
    reading_.push_n = held;
    reading_.fresh = fresh;
    readings_.put(reading_);
  }
  Vector3d wanted() {
    const auto now = Now::now();
    if (commands_.take(wanted_)) commanded_at_ = now;
    if (now - commanded_at_ > kSilence || now - read_at_ > kSilence || !wanted_.allFinite()) return Vector3d::Zero();
    return wanted_ * std::min(1.0, kMostForce / wanted_.norm());
  }
  /// Without an answer nothing more is sent, upon which the service lets the device go.
  void exchange(const Vector3d& push) {
    const std::string command = inverse3_command(id_, push, std::exchange(first_, false));
    Error error = complete(kSilence, [&](auto done) { stream_->async_write(asio::buffer(command), done); });
    if (!error) error = read(kSilence);
    // Of a service that says more than it is asked the newest counts.
    for (int more = 0; !error && more < kMostMore && stream_->next_layer().socket().available(error) > 0; ++more)
      error = read(kSilence);
    error ? stream_.reset() : static_cast<void>(pass_on(push));
  }
  void run() {
    take_ordinary_priority();
    for (auto next = Now::now(); going_; std::this_thread::sleep_until(next)) {
      const Vector3d push = wanted();
      stream_ ? exchange(push) : static_cast<void>(connect(kSilence));
      if (!stream_) tell(held_ = Vector3d::Zero(), false);
      next = std::max(next + (stream_ ? pause_ : kRetry), Now::now());
    }
    if (stream_) exchange(Vector3d::Zero());
    if (stream_) complete(kSilence, [&](auto done) { stream_->async_close(beast::websocket::normal, done); });
  }

  std::string where_, id_;
  Duration pause_;
  asio::io_context context_;
  tcp::resolver::results_type endpoints_;
  std::optional<beast::websocket::stream<beast::tcp_stream, false>> stream_;  ///< none: no connection
  beast::flat_buffer heard_;
  bool first_ = true;  ///< the next command of this connection
  Reading reading_;
  Vector3d wanted_ = Vector3d::Zero(), held_ = Vector3d::Zero();
  Now::time_point read_at_, commanded_at_;
  Newest<Reading> readings_;
  Newest<Vector3d> commands_;
  std::atomic<bool> going_{true};
  std::thread thread_;
};

/// A Haply Inverse3 in the axes and units of its service.
class Inverse3Device final : public Device<3> {
 public:
  explicit Inverse3Device(const DriverOptions& o) : service_{o.arguments, o.period} {}

  [[nodiscard]] DeviceInfo info() const override {
    return {.name = service_.name(), .max_force_n = kMostForce, .watchdog = to_seconds(kSilence), .dof = 3};
  }
  DeviceSample<3> sense(const Tick<MasterClock>&) noexcept override {
    const bool fresh = service_.take(reading_) && reading_.fresh;
    return {.x = Position<3>{reading_.x_m},
            .v = Velocity<3>{reading_.v_m_per_s},
            .applied = Force<3>{-reading_.push_n},
            .status = fresh ? HardwareStatus::ok : HardwareStatus::stale};
  }
  void actuate(const Force<3>& f) noexcept override { service_.push(-f.vec()); }
  void release() noexcept override { service_.push(Vector3d::Zero()); }

 private:
  Service service_;
  Reading reading_;
};

}  // namespace

void add_inverse3(Registry& all) {
  all.devices.add<Inverse3Device>("inverse3", "Haply Inverse3 by its service; ARGS is ADDRESS:PORT (localhost:10001)");
}

}  // namespace twoport
