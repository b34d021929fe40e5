#pragma once

#include <memory>

#include "common/base/time.h"
#include "common/scene/scene.h"
#include "master/page_samples.h"

namespace twoport::playground {

/// A scene that runs in the page. Its hand is the page's pointer, or where `scripted` that of the scene.
class Run {
 public:
  virtual ~Run() = default;
  virtual void until(Duration end) = 0;
  [[nodiscard]] virtual PageSamples& page() = 0;
};

template <int N>
std::unique_ptr<Run> make_run(const Scene& scene, bool scripted);
extern template std::unique_ptr<Run> make_run<1>(const Scene&, bool);
extern template std::unique_ptr<Run> make_run<3>(const Scene&, bool);
extern template std::unique_ptr<Run> make_run<6>(const Scene&, bool);

}  // namespace twoport::playground
