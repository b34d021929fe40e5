#pragma once

#define BOOST_ASIO_NO_DEPRECATED
#define BOOST_BEAST_USE_STD_STRING_VIEW
#define BOOST_ASIO_DISABLE_FENCED_BLOCK
#define BOOST_BIND_GLOBAL_PLACEHOLDERS
#include <fmt/format.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <boost/asio/buffer.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core/buffers_to_string.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/websocket.hpp>
#include <boost/property_tree/json_parser.hpp>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <sstream>
#include <string>
#include <thread>
#include <utility>

namespace twoport::test {

/// Speaks as the Haply Inverse Service does (docs.haply.co, Inverse SDK 3.5.x, "WebSocket Protocol" and "Control Commands"): all that it
/// knows at first, then one state for each command. Its handle is a mass of 0.1 kg in a hand of 300 N/m, which moves along x at 0.1 m/s.
class Inverse3Service {
 public:
  enum class Answers { well, twice, nothing, garbage, infinity, uncalibrated };

  explicit Inverse3Service(std::uint16_t port = 0, bool has_device = true)
      : has_device_{has_device}, acceptor_{context_, {boost::asio::ip::address_v4::loopback(), port}} {
    thread_ = std::thread{[this] { serve(); }};
  }
  ~Inverse3Service() {
    going_ = false;
    shutdown(acceptor_.native_handle(), SHUT_RDWR);
    shutdown(client_, SHUT_RDWR);
    thread_.join();
  }
  Inverse3Service(const Inverse3Service&) = delete;

  [[nodiscard]] std::uint16_t port() const { return acceptor_.local_endpoint().port(); }
  [[nodiscard]] std::string choice() const { return "inverse3:127.0.0.1:" + std::to_string(port()); }
  /// The newest force on the hand.
  [[nodiscard]] double push_n(int axis) const { return push_n_[static_cast<std::size_t>(axis)]; }

  std::atomic<Answers> answers{Answers::well};
  std::atomic<double> aim_m{0.0};  ///< where the hand goes
  std::atomic<long> commands{0};
  std::atomic<double> x_m{0.0}, most_push_n{0.0};
  std::atomic<double> told_n{0.0};  ///< size of the force of the last command

 private:
  using Socket = boost::beast::websocket::stream<boost::asio::ip::tcp::socket, false>;
  using Error = boost::system::error_code;

  std::string state(bool first) {
    const Answers how = answers;
    if (how == Answers::garbage)
      return R"({"session_id":7,"inverse3":[{"device_id":"049D","state":{"cursor_position":{)";
    const std::string config =
        R"("config":{"type":"inverse3","device_info":{"major_version":7,"minor_version":4},"preset":"defaults"},)";
    const std::string device = fmt::format(
        R"({{"device_id":"049D",{}"state":{{"cursor_position":{{"x":{},"y":-0.12,"z":0.15}},"cursor_velocity":{{"x":{},"y":0.0,"z":0.0}},)"
        R"("angular_position":{{"a0":0.0,"a1":0.0,"a2":0.0}},"control_domain":"cartesian","control_mode":"idle"}},"status":{{"calibrated":{}}}}})",
        first ? config : "", how == Answers::infinity ? "1e999" : fmt::format("{:.9g}", x_m.load()), v_,
        how != Answers::uncalibrated);
    return fmt::format(R"({{"session_id":7,"inverse3":[{}],"verse_grip":[],"wireless_verse_grip":[]}})",
                       has_device_ ? device : "");
  }
  void take(const std::string& command) {
    boost::property_tree::ptree all;
    std::istringstream text{command};
    read_json(text, all);
    const auto& device = all.get_child("inverse3").front().second;
    if (device.get<std::string>("device_id") != "049D") return;
    const auto& force = device.get_child("commands.set_cursor_force.vector");
    for (int i = 0; i < 3; ++i) push_n_[static_cast<std::size_t>(i)] = force.get<double>(std::string{"xyz"[i]});
    most_push_n = std::max(most_push_n.load(), std::abs(push_n(0)));
    told_n = std::hypot(push_n(0), push_n(1), push_n(2));
    ++commands;
  }
  /// The handle under the force that it was told, in steps of 0.1 ms.
  void move() {
    const auto now = std::chrono::steady_clock::now();
    constexpr double dt = 1e-4;
    for (; at_ < now; at_ += std::chrono::microseconds{100}) {
      hand_ += std::clamp(aim_m - hand_, -0.1 * dt, 0.1 * dt);
      v_ += dt / 0.1 * (300.0 * (hand_ - x_m) - 6.0 * v_ + push_n_[0]);
      x_m = x_m + dt * v_;
    }
  }
  void serve() {
    while (going_) {
      Error error;
      boost::asio::ip::tcp::socket accepted{context_};
      acceptor_.accept(accepted, error);
      if (error) return;
      client_ = accepted.native_handle();
      Socket socket{std::move(accepted)};
      socket.next_layer().set_option(boost::asio::ip::tcp::no_delay{true}, error);
      socket.accept(error);
      at_ = std::chrono::steady_clock::now();
      for (bool first = true; !error; first = false) {
        move();
        for (int n = answers == Answers::nothing ? 0 : answers == Answers::twice ? 2 : 1; n > 0 && !error; --n)
          socket.write(boost::asio::buffer(state(first)), error);
        boost::beast::flat_buffer heard;
        if (!error) socket.read(heard, error);
        if (!error) take(boost::beast::buffers_to_string(heard.data()));
      }
      // Without commands it lets go.
      for (auto& f : push_n_) f = 0.0;
      client_ = -1;
    }
  }

  bool has_device_;
  boost::asio::io_context context_;
  boost::asio::ip::tcp::acceptor acceptor_;
  double v_ = 0.0, hand_ = 0.0;
  std::chrono::steady_clock::time_point at_;
  std::array<std::atomic<double>, 3> push_n_{};
  std::atomic<int> client_{-1};
  std::atomic<bool> going_{true};
  std::thread thread_;
};

}  // namespace twoport::test
