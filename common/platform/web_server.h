#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace twoport {

/// Longest header of a request that is read [B].
inline constexpr std::size_t kLargestRequest = 8192;

/// The port of `host`, 80 unless it names one, where it is an address that a name server cannot redirect: localhost or an IP address.
std::optional<unsigned> port_of_literal_host(std::string_view host);

/// Is it such an address, with this port? Refusing any other name prevents DNS rebinding.
bool is_literal_host(std::string_view host, std::uint16_t port);

/// Does a request to `host` come from a page that this server has delivered? Other web sites may open a WebSocket to
/// localhost too; the browser states their Origin.
bool is_own_origin(std::string_view host, std::string_view origin);

class WebConnection;

/// A WebSocket of a server. All is called on the server's thread.
class WebSession {
 public:
  using Text = std::shared_ptr<const std::string>;

  virtual ~WebSession() = default;
  virtual void opened() = 0;
  virtual void heard(std::string_view message, bool is_text) = 0;
  /// The message of write() has left.
  virtual void sent() = 0;
  /// The last call, also of one that was never opened.
  virtual void closed() = 0;

  [[nodiscard]] bool is_writing() const;
  /// Nothing where another message is on its way, where it has not opened or has ended, and without a text.
  void write(Text text, bool is_text);
  /// Sends the code of RFC 6455, 7.4.1, and closes.
  void end(std::uint16_t code);

 private:
  friend WebConnection;
  WebConnection* connection_ = nullptr;
};

/// Header of a request that is well formed: without a body, with at most one Host and Origin, of a file here.
struct WebRequest {
  std::string_view method, target, host, origin;
  std::vector<std::string_view> protocols;  ///< offered for a WebSocket
  bool upgrades = false;                    ///< to a WebSocket of RFC 6455
};

/// A response, or the session of a WebSocket that opens.
struct WebAnswer {
  unsigned status = 200;
  std::string body{};
  std::vector<std::pair<std::string, std::string>> fields{};
  std::unique_ptr<WebSession> session{};
  std::string protocol{};  ///< of a WebSocket; empty: none is named

  /// A sentence for people, ending in a line feed.
  static WebAnswer refusal(unsigned status, std::string_view why);
};

/// HTTP and WebSockets on a thread of its own at ordinary priority. Ended: a request that is not complete after `request_time`, a WebSocket that
/// answers no ping for `silence` or takes nothing for `patience`, and of more than 16 other connections, closing ones among them, the oldest.
class WebServer {
 public:
  using Milliseconds = std::chrono::milliseconds;
  struct Options {
    std::string address;          ///< ADDR:PORT; port 0: any free one
    const char* flag;             ///< whose value that is
    std::size_t largest_message;  ///< of a WebSocket that is read [B]
    Milliseconds every, request_time{5000}, ping_every{2000}, silence{5000}, patience{10000};
    std::function<WebAnswer(const WebRequest&)> answer{};
    std::function<void()> tick{};  ///< `every`
  };
  /// Binds. Throws ConfigError with the address and what to do.
  explicit WebServer(Options options);
  ~WebServer();
  WebServer(const WebServer&) = delete;

  void start();
  /// Has `f` called on the thread.
  void post(std::function<void()> f);
  /// "127.0.0.1:45080" as others reach it.
  [[nodiscard]] const std::string& address() const;
  [[nodiscard]] std::uint16_t port() const;
  /// Is it bound to an address of this machine only?
  [[nodiscard]] bool is_local() const;

 private:
  friend WebConnection;
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace twoport
