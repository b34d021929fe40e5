#include "common/base/check.h"
#include "common/hardware/registry.h"
#include "drivers/page_leader.h"

namespace twoport {
namespace {

template <int N>
class PageDriver final : public PageDevice<N> {
 public:
  explicit PageDriver(const DriverOptions& o) : PageDevice<N>{o.scene, o.period.si(), channel(o)} {}

 private:
  static PageChannel* channel(const DriverOptions& o) {
    if (!o.arguments.empty()) throw ConfigError{"--device page:" + o.arguments + ": page takes no arguments"};
    if (o.page == nullptr) throw ConfigError{"--device page: this program serves no page; add --page"};
    return o.page;
  }
};

}  // namespace

void add_page(Registry& all) {
  all.devices.add<PageDriver>("page", "the mouse or a finger on the page of --page");
}

}  // namespace twoport
