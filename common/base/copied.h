#pragma once

#include <memory>
#include <utility>

namespace twoport {

/// Owns an object of a class derived from T; a copy owns one of its own, made by T::copy().
template <class T>
class Copied {
 public:
  Copied() = default;
  Copied(std::unique_ptr<T> object) noexcept : object_{std::move(object)} {}  // NOLINT(google-explicit-constructor)
  Copied(const Copied& other) : object_{other.object_ ? other.object_->copy() : nullptr} {}
  Copied(Copied&&) noexcept = default;
  Copied& operator=(Copied other) noexcept {
    object_ = std::move(other.object_);
    return *this;
  }
  ~Copied() = default;

  explicit operator bool() const noexcept { return object_ != nullptr; }
  [[nodiscard]] T* get() const noexcept { return object_.get(); }
  T* operator->() const noexcept { return object_.get(); }
  T& operator*() const noexcept { return *object_; }

 private:
  std::unique_ptr<T> object_;
};

}  // namespace twoport
