#include "web/playground/make_run.h"

namespace twoport::playground {

template std::unique_ptr<Run> make_run<1>(const Scene&, bool);

}  // namespace twoport::playground
