#pragma once

#include <stdexcept>
#include <string>

namespace twoport {

/// What the user gave cannot be used: one sentence naming the thing, the value and what is allowed.
/// Thrown while a scene is read and a program is built, never in a control step.
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
