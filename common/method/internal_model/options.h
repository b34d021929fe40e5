#pragma once

namespace twoport {

/// `control.passivity.internal_model`.
struct InternalModelOptions {
  bool strict_two_port = false;  ///< also the slave's port takes no more than the hand has put in
};

}  // namespace twoport
