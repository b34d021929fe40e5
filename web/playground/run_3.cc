#include "web/playground/make_run.h"

namespace twoport::playground {

template std::unique_ptr<Run> make_run<3>(const Scene&, bool);

}  // namespace twoport::playground
