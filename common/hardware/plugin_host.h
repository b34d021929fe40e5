#pragma once

#include <memory>
#include <optional>
#include <string>

#include "common/base/scalar.h"

namespace twoport {

/// "PATH.so[:ARGS]" of --device or --robot.
struct PluginChoice {
  std::string path, arguments;
};
/// Empty where `choice` is a driver's name.
std::optional<PluginChoice> plugin_choice(const std::string& choice);

/// Loads a plug-in (plugin.h) and opens its hardware as Hardware<N>, which is Device<N> or Robot<N>, with `dof` degrees of freedom: N, or
/// of a port of joints their number, 0 for any. Throws ConfigError with one sentence: no such file, not a library, not a plug-in of this
/// kind, of another version, fewer degrees of freedom or another number of joints, or what the plug-in says. The library is loaded in a
/// process of its own first, which its static objects may end; then it stays loaded until the program ends.
template <template <int> class Hardware, int N>
std::unique_ptr<Hardware<N>> open_plugin(const std::string& flag, const PluginChoice& choice, int dof, Seconds period);

/// What is being caught, in words.
std::string current_words();

/// Looks whether a shared library is whole, and loads it in a process of its own: code that runs when it is loaded can end a process
/// in ways that no caller of dlopen survives. Returns why it must not be loaded; empty: it may. An error of dlopen is left to the
/// caller.
std::string try_to_load(const std::string& path);

}  // namespace twoport
