#pragma once

#include <chrono>
#include <cstddef>
#include <memory>
#include <string>
#include <string_view>

#include "common/page/channel.h"
#include "common/page/judge.h"

namespace twoport {

/// Longest message of a WebSocket that is read [B].
inline constexpr std::size_t kLargestMessage = 1024;

/// Serves the page over HTTP and its samples over a WebSocket, on a thread of its own at ordinary priority. Samples go
/// out as one binary message at about 60 Hz; of a slow reader only the newest pending message is kept. When a client that
/// holds the handle goes, the handle is released.
///
/// One client controls the run: the first, until it goes or another one takes the handle, or asks to take over, while nobody holds it.
/// Commands of the others have no effect. Each client is told in a text message whether it controls, what the judge says of the run,
/// and its end:
///
///     {"controls": true, "verdict": "passive", "reason": "…", "initial_energy_j": 0.001, "earlier_debt_j": 0,
///      "both_initial_energy_j": -1, "both_earlier_debt_j": 0, "end": null}
///
/// Beyond this machine the page and its WebSocket need the token that url() holds: a random number of 128 bits.
///
/// Refused: a Host that is not localhost or an IP address with this port, a WebSocket of another Origin, requests and
/// messages beyond kLargestRequest and kLargestMessage, more than eight WebSockets. Ended: a request that is not complete
/// after `request_time`, a WebSocket that answers no ping for `silence`, and of more than sixteen other connections the oldest. Where
/// eight WebSockets are open, a ninth takes the place of the one that has given no command for longest, at least `spectator_time`:
/// a page gives one when its user does something. Who holds the handle keeps the place.
class PageServer {
 public:
  struct Options {
    std::string address{};       ///< value of --page, ADDR:PORT; port 0: any free one
    std::string introduction{};  ///< text message that each client gets first
    std::string_view page{};     ///< the HTML file
    bool joints = false;         ///< the ports are joints
    bool restartable = false;    ///< a page may end the program (SIGTERM) to have it started again
    std::chrono::milliseconds request_time{5000}, ping_every{2000}, silence{5000}, spectator_time{30000};
  };
  /// Binds and starts. `channel` must outlive this. `judge` has seen nothing yet. Throws ConfigError with the address and what to do.
  PageServer(const Options& options, PageChannel& channel, PageJudge judge);
  ~PageServer();
  PageServer(const PageServer&) = delete;

  /// Tells all pages that the run is over, and how.
  void end(const std::string& verdict);

  /// Has a page ended the program?
  [[nodiscard]] bool restarts() const;
  /// "http://127.0.0.1:45080/", with the port that was taken, and with the token where it is not bound to this machine only.
  [[nodiscard]] const std::string& url() const;
  /// Is it bound to an address of this machine only?
  [[nodiscard]] bool is_local() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace twoport
