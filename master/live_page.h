#pragma once

#include <algorithm>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "common/page/describe.h"
#include "common/platform/live_run.h"
#include "common/platform/page_server.h"
#include "master/page_samples.h"

namespace twoport {

/// The master's side of the live page.
class LivePage : public PageSamples {
 public:
  /// Nothing is served yet. Null where neither --page nor --device page is given.
  static std::unique_ptr<LivePage> wanted(const LiveArguments& a) {
    if (a.page.empty()) return nullptr;
    return std::make_unique<LivePage>();
  }

  /// From now on the page is there. `world`: what it draws around the robot; nothing: the scene's.
  void serve(const Scene& scene, const LiveArguments& a, const std::string& device, std::optional<ShownShapes> world,
             spdlog::logger& log) {
    begin(scene);
    const bool pointer = a.hardware == "page";
    const PageServer::Options options{
        .address = a.page,
        .introduction = describe_for_page(scene, {.device = device,
                                                  .has_pointer = pointer,
                                                  .restarts = a.restartable,
                                                  .grip_n_per_m = channel()->pointer.grip_n_per_m,
                                                  .methods = configurations(scene),
                                                  .world = std::move(world)}),
        .page = page_html(),
        .joints = scene.joints > 0,
        .restartable = a.restartable};
    server_.emplace(options, *channel(), PageJudge{scene, std::min(kSampleHz, scene.master_rate_hz), pointer});
    log.info("page: {}", server_->url());
    if (!server_->is_local())
      log.warn(
          "the page is not encrypted: whoever has this link, or hears it on the network, can watch and move the robot");
  }
  /// Tells the pages how the run has ended.
  void end(const Summary& s) {
    if (server_) server_->end(s.verdict_kind() + ": " + s.verdict());
  }
  /// Has the page ended the program to have it started again?
  [[nodiscard]] bool restarts() const noexcept { return server_ && server_->restarts(); }

 private:
  std::optional<PageServer> server_;
};

}  // namespace twoport
