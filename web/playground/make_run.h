#pragma once

#include <memory>

#include "common/hardware/mounted.h"
#include "drivers/page_device.h"
#include "drivers/simulated.h"
#include "master/page_samples.h"
#include "master/render_node.h"
#include "master/with_device.h"
#include "web/playground/session.h"

namespace twoport::playground {

/// A scene that runs in the page. Its hand is the page's pointer, or where `scripted` that of the scene.
class Run {
 public:
  virtual ~Run() = default;
  virtual void until(Duration end) = 0;
  [[nodiscard]] virtual PageSamples& page() = 0;
};

/// Limits of the network that the page adds.
inline ImpairmentOptions most_added() {
  return {.delay_s = 1e-3 * kPageDelayMs, .jitter_s = 1e-3 * kPageJitterMs, .loss = kPageLoss};
}

template <int N>
std::shared_ptr<Device<N>> make_device(const Scene& scene, bool scripted, PageChannel* channel) {
  const double period_s = 1.0 / scene.master_rate_hz;
  if (scripted) return std::make_shared<SimulatedDevice<N>>(scene, Seconds{period_s});
  return std::make_shared<PageDevice<N>>(scene, period_s, channel);
}

/// A run over a link.
template <int N>
class LinkRun final : public Run {
 public:
  LinkRun(const Scene& read, bool scripted)
      : device_{make_device<N>(read, scripted, page_.channel())},
        scene_{scripted ? read : with_device(read, device_->info())},
        order_{scene_},
        robot_{scene_, order_.slave_period()},
        mounted_{device_, {}},
        session_{scene_, mounted_, robot_, most_added()},
        registration_{scene_.control} {
    page_.begin(scene_);
    if (!scene_.gripper || !device_->gripper() || !robot_.gripper()) return;
    gripper_.emplace(scripted ? *scene_.gripper : with_device(*scene_.gripper, device_->gripper()->info()),
                     *device_->gripper(), *robot_.gripper(), most_added());
  }
  void until(Duration end) override {
    PageCommand command;
    while (page_.channel()->commands.try_pop(command)) obey(command);
    order_.run(
        end,
        [this](lab::TickAt at) {
          session_.slave_tick(at);
          if (gripper_) gripper_->slave_tick(at);
        },
        [this](lab::TickAt at) {
          const auto out = session_.master_tick(at);
          if (gripper_) {
            const auto of_gripper = gripper_->master_tick(at);
            page_.note_gripper(gripper_->device().x, gripper_->known(), of_gripper.command,
                               gripper_->master.observed());
          }
          robot_.describe(environment_);
          if (refused_) environment_.answer = EnvironmentAnswer::out_of_range;
          environment_.link_energy_j = -session_.slave.delivered().si();
          page_.note_environment(environment_, registration_);
          page_.note_handle(mounted_, session_.device().x);
          page_.show(at.now, Duration{0}, session_.device(), out, session_.master.observed(), &session_.known(),
                     session_.counts(), session_.master.limit_counts(), session_.master.epoch());
          return true;
        });
  }
  [[nodiscard]] PageSamples& page() override { return page_; }

 private:
  void obey(const PageCommand& c) noexcept {
    switch (c.kind) {
      case PageCommand::Kind::network:
        session_.adjust(c.which == 0, 1e-3 * c.number[0], 1e-3 * c.number[1], c.number[2]);
        if (gripper_) gripper_->adjust(c.which == 0, 1e-3 * c.number[0], 1e-3 * c.number[1], c.number[2]);
        break;
      case PageCommand::Kind::method: {
        const auto all = static_cast<std::uint32_t>(scene_.schedule.size() + 1);
        const auto to = static_cast<std::uint32_t>(c.which);
        while (to < all && session_.master.epoch() % all != to) session_.master.switch_to_next();
        break;
      }
      case PageCommand::Kind::surface: {
        const auto which = static_cast<std::size_t>(c.which);
        robot_.describe(environment_);
        if (which >= environment_.count) break;
        EnvironmentMessage::Surface& surface = environment_.surface[which];
        surface = {c.number[0], surface.friction < 0.0 ? -1.0 : c.number[1]};
        refused_ = !robot_.adjust(environment_);
        break;
      }
      default:
        change_handle(mounted_, c);
        break;
    }
  }
  PageSamples page_;
  std::shared_ptr<Device<N>> device_;
  Scene scene_;
  lab::TickOrder order_;
  SimulatedRobot<N> robot_;
  MountedDevice<N> mounted_;
  Session<N> session_;
  Registration<N> registration_;
  std::optional<Session<1>> gripper_;  ///< of the scene
  EnvironmentMessage environment_;
  bool refused_ = false;
};

/// A virtual environment on the handle, without a link.
template <int N>
class RenderRun final : public Run {
 public:
  RenderRun(const Scene& read, bool scripted)
      : device_{make_device<N>(read, scripted, page_.channel())},
        scene_{scripted ? read : with_device(read, device_->info())},
        order_{scene_},
        environment_{scene_.environment, scene_.tool},
        node_{scene_.control, environment_},
        plant_{*device_, {}} {
    page_.begin(scene_);
    device_->start();
    initial_ = scene_.control.initial_energy +
               environment_.potential(device_->truth() ? device_->truth()->x : first_reading().x);
  }
  void until(Duration end) override {
    order_.run(
        end, [](lab::TickAt) {},
        [this](lab::TickAt at) {
          const Tick<MasterClock> tick{Instant<MasterClock>{at.now}, Seconds{1.0 / scene_.master_rate_hz}};
          const auto out = run_cycle(node_, plant_, mail_, tick);
          page_.show(at.now, Duration{0}, plant_.sample, out, node_.observed() - initial_,
                     static_cast<PeerState<N>*>(nullptr), {}, node_.limit_counts(), 0);
          return true;
        });
  }
  [[nodiscard]] PageSamples& page() override { return page_; }

 private:
  DeviceSample<N> first_reading() noexcept {
    return device_->sense(Tick<MasterClock>{Instant<MasterClock>{}, Seconds{1.0 / scene_.master_rate_hz}});
  }

  PageSamples page_;
  std::shared_ptr<Device<N>> device_;
  Scene scene_;
  lab::TickOrder order_;
  Environment<N> environment_;
  RenderNode<N> node_;
  NoMail mail_;
  Sensed<Device<N>, DeviceSample<N>> plant_;
  Energy initial_;
};

template <int N>
std::unique_ptr<Run> make_run(const Scene& scene, bool scripted) {
  if (scene.control.architecture == Architecture::render) return std::make_unique<RenderRun<N>>(scene, scripted);
  return std::make_unique<LinkRun<N>>(scene, scripted);
}

}  // namespace twoport::playground
