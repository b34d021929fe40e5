#pragma once

namespace twoport {

/// From the first call on: how often z and Enter have been typed at the terminal of the program. Where its input is no terminal: 0.
unsigned zeroings_by_hand() noexcept;

}  // namespace twoport
