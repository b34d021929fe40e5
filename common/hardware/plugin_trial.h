#pragma once

#include <string>

namespace twoport {

/// What is being caught, in words.
std::string current_words();

/// Looks whether a shared library is whole, and loads it in a process of its own: code that runs when it is loaded can end a process
/// in ways that no caller of dlopen survives. Returns why it must not be loaded; empty: it may. An error of dlopen is left to the
/// caller.
std::string try_to_load(const std::string& path);

}  // namespace twoport
