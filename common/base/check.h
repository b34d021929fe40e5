#pragma once

#include <stdexcept>
#include <string>

namespace twoport {

/// Invalid user input: one sentence with the name, the value and what is allowed. Thrown while a scene is read and a
/// program is set up, never in a control step.
class ConfigError : public std::runtime_error {
 public:
  explicit ConfigError(const std::string& sentence) : std::runtime_error{sentence} {}
};

/// A file could not be read or written while the program ran.
class IoError : public std::runtime_error {
 public:
  explicit IoError(const std::string& sentence) : std::runtime_error{sentence} {}
};

}  // namespace twoport
