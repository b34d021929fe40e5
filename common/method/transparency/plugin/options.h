#pragma once

#include <memory>
#include <string>

#include "common/base/option_fields.h"

namespace twoport {

class TransparencyHost;

/// `control.transparency.plugin`.
struct PluginOptions {
  std::string file, arguments;
  bool waits = false;                      ///< virtual time
  std::shared_ptr<TransparencyHost> host;  ///< given by a caller in place of a file
  TWOPORT_OPTIONS_OF_BLOCK(file, arguments)
};

}  // namespace twoport
