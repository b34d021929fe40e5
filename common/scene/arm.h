#pragma once

#include <string>

#include "common/arm/parameters.h"
#include "common/scene/shown.h"

namespace twoport {

/// Reads an arm of any number of joints from a file in Protobuf text format (proto/arm.proto), or from a `.urdf` up to its link `tip`;
/// "": the only link without children that a joint moves. Throws ConfigError with file, field or name, value and what is allowed.
ArmParameters load_arm(const std::string& path, const std::string& tip = {});

/// The shapes of the links of that arm, with the same errors; none where the file is no URDF and names none.
ShownArm load_arm_shapes(const std::string& path);

/// The file of an arm that something in `folder` names: that file where there is one, else the arm of the project with this name
/// ("ur5e"), in `arms`. As scene_file() otherwise.
std::string arm_file(const std::string& named, const std::string& folder = {});

/// What an inertia about a centre of mass must do and does not [kg m²]; "": it is that of a body. `rounding`: that its moments may miss it by.
std::string inertia_fault(const Eigen::Matrix3d& inertia, double rounding = 0.0);

// Internal to common/scene.

/// Reads the arm between the root and the link `tip` of a URDF; "": the only link without children that a joint moves. Fixed joints join their links;
/// joints beside the arm are held at 0 or at the nearer limit. Throws ConfigError with file, line and name.
ArmParameters read_urdf(const std::string& text, const std::string& file, const std::string& tip);

/// The shapes of its links that are seen, `visual`; of a link whose `visual` cannot be read those of its `collision`, with the same errors otherwise.
ShownArm read_urdf_shapes(const std::string& text, const std::string& file, const std::string& tip);

}  // namespace twoport
