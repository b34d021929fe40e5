#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "common/method/method.h"

namespace twoport {

/// Names of all methods, in the order of the catalogue.
std::vector<std::string> method_names();
/// Does a controller at the master keep an account of energy, so that a deficit is known? Under any of these controls.
bool keeps_account(const ControlOptions& first, std::span<const ScheduledControl> schedule);

/// A half whose method is selected at construction, with one indirect call per tick. Allocates at construction only.
template <int N>
class AnyMasterHalf {
 public:
  struct Concept {
    virtual ~Concept() = default;
    [[nodiscard]] virtual std::unique_ptr<Concept> copy() const = 0;
    virtual void start(const DeviceSample<N>& device) noexcept = 0;
    virtual MasterOutput<N> step(const MasterInput<N>& in) noexcept = 0;
    [[nodiscard]] virtual Energy deficit(const Ledger& account, Energy slave_energy_in) const noexcept = 0;
    virtual void restart(const Ledger& account, Energy deficit) noexcept = 0;
    [[nodiscard]] virtual bool has_payload() const noexcept = 0;
    virtual void write_payload(Words& words) const noexcept = 0;
  };
  template <MasterHalf<N> H>
  struct Model final : Concept {
    explicit Model(const ControlOptions& o) : half{o} {}
    [[nodiscard]] std::unique_ptr<Concept> copy() const override { return std::make_unique<Model>(*this); }
    void start(const DeviceSample<N>& device) noexcept override { half.start(device); }
    MasterOutput<N> step(const MasterInput<N>& in) noexcept override { return half.step(in); }
    [[nodiscard]] Energy deficit(const Ledger& account, Energy e) const noexcept override {
      return half.deficit(account, e);
    }
    void restart(const Ledger& account, Energy e) noexcept override { half.restart(account, e); }
    [[nodiscard]] bool has_payload() const noexcept override { return half.has_payload(); }
    void write_payload(Words& words) const noexcept override { half.write_payload(words); }
    H half;
  };

  /// The half of the method that `o.method` names (common/method/any.cc).
  explicit AnyMasterHalf(const ControlOptions& o);
  AnyMasterHalf(const AnyMasterHalf& other) : half_{other.half_->copy()} {}
  AnyMasterHalf(AnyMasterHalf&&) noexcept = default;
  AnyMasterHalf& operator=(AnyMasterHalf&&) noexcept = default;

  void start(const DeviceSample<N>& device) noexcept { half_->start(device); }
  MasterOutput<N> step(const MasterInput<N>& in) noexcept { return half_->step(in); }
  [[nodiscard]] Energy deficit(const Ledger& account, Energy e) const noexcept { return half_->deficit(account, e); }
  void restart(const Ledger& account, Energy e) noexcept { half_->restart(account, e); }
  [[nodiscard]] bool has_payload() const noexcept { return half_->has_payload(); }
  void write_payload(Words& words) const noexcept { half_->write_payload(words); }

 private:
  std::unique_ptr<Concept> half_;
};

/// As AnyMasterHalf.
template <int N>
class AnySlaveHalf {
 public:
  struct Concept {
    virtual ~Concept() = default;
    [[nodiscard]] virtual std::unique_ptr<Concept> copy() const = 0;
    virtual void start(const RobotSample<N>& robot, const PeerState<N>& master) noexcept = 0;
    virtual SlaveOutput<N> step(const SlaveInput<N>& in) noexcept = 0;
    virtual SlaveOutput<N> fail_safe(const Ledger& account) noexcept = 0;
    [[nodiscard]] virtual Energy deficit(const Ledger& account, Energy master_energy_in) const noexcept = 0;
    virtual void restart(const Ledger& account, Energy deficit) noexcept = 0;
    [[nodiscard]] virtual bool has_payload() const noexcept = 0;
    virtual void write_payload(Words& words) const noexcept = 0;
    [[nodiscard]] virtual SlaveHandover<N> handover() const noexcept = 0;
    virtual void resume(const SlaveHandover<N>& from) noexcept = 0;
    [[nodiscard]] virtual Position<N> target() const noexcept = 0;
    virtual void limited(SlaveOutput<N>& out, const RobotCommand<N>& asked, const RobotSample<N>& robot,
                         Seconds dt) noexcept = 0;
  };
  template <SlaveHalf<N> H>
  struct Model final : Concept {
    explicit Model(const ControlOptions& o) : half{o} {}
    [[nodiscard]] std::unique_ptr<Concept> copy() const override { return std::make_unique<Model>(*this); }
    void start(const RobotSample<N>& robot, const PeerState<N>& master) noexcept override { half.start(robot, master); }
    SlaveOutput<N> step(const SlaveInput<N>& in) noexcept override { return half.step(in); }
    SlaveOutput<N> fail_safe(const Ledger& account) noexcept override { return half.fail_safe(account); }
    [[nodiscard]] Energy deficit(const Ledger& account, Energy e) const noexcept override {
      return half.deficit(account, e);
    }
    void restart(const Ledger& account, Energy e) noexcept override { half.restart(account, e); }
    [[nodiscard]] SlaveHandover<N> handover() const noexcept override { return half.handover(); }
    void resume(const SlaveHandover<N>& from) noexcept override { half.resume(from); }
    [[nodiscard]] Position<N> target() const noexcept override { return half.target(); }
    void limited(SlaveOutput<N>& out, const RobotCommand<N>& asked, const RobotSample<N>& robot,
                 Seconds dt) noexcept override {
      tell_limited(half, out, asked, robot, dt);
    }
    [[nodiscard]] bool has_payload() const noexcept override { return half.has_payload(); }
    void write_payload(Words& words) const noexcept override { half.write_payload(words); }
    H half;
  };

  explicit AnySlaveHalf(const ControlOptions& o);
  AnySlaveHalf(const AnySlaveHalf& other) : half_{other.half_->copy()} {}
  AnySlaveHalf(AnySlaveHalf&&) noexcept = default;
  AnySlaveHalf& operator=(AnySlaveHalf&&) noexcept = default;

  void start(const RobotSample<N>& robot, const PeerState<N>& master) noexcept { half_->start(robot, master); }
  SlaveOutput<N> step(const SlaveInput<N>& in) noexcept { return half_->step(in); }
  SlaveOutput<N> fail_safe(const Ledger& account) noexcept { return half_->fail_safe(account); }
  [[nodiscard]] Energy deficit(const Ledger& account, Energy e) const noexcept { return half_->deficit(account, e); }
  void restart(const Ledger& account, Energy e) noexcept { half_->restart(account, e); }
  [[nodiscard]] SlaveHandover<N> handover() const noexcept { return half_->handover(); }
  void resume(const SlaveHandover<N>& from) noexcept { half_->resume(from); }
  [[nodiscard]] Position<N> target() const noexcept { return half_->target(); }
  void limited(SlaveOutput<N>& out, const RobotCommand<N>& asked, const RobotSample<N>& robot, Seconds dt) noexcept {
    half_->limited(out, asked, robot, dt);
  }
  [[nodiscard]] bool has_payload() const noexcept { return half_->has_payload(); }
  void write_payload(Words& words) const noexcept { half_->write_payload(words); }

 private:
  std::unique_ptr<Concept> half_;
};

/// A method chosen by name when the halves are built.
struct AnyMethod {
  template <int N>
  using Master = AnyMasterHalf<N>;
  template <int N>
  using Slave = AnySlaveHalf<N>;
};

extern template class AnyMasterHalf<1>;
extern template class AnyMasterHalf<3>;
extern template class AnyMasterHalf<6>;
extern template class AnySlaveHalf<1>;
extern template class AnySlaveHalf<3>;
extern template class AnySlaveHalf<6>;

}  // namespace twoport
