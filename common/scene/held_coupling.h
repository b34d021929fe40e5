#pragma once

#include "common/coupling/options.h"
#include "common/scene/scene.h"

namespace twoport {

/// Does the robot of the scene come to rest by itself on this virtual coupling, whose force is held over a tick, with the set
/// point at rest and nothing touched? Of an arm about its first position, with its joints' inertia and damping.
///
/// A mass m with damping b of its own under F = -K x - B v, held for T, does so where the eigenvalues of
///
///     A = [1 - l K, h - l B; -g K, a - g B],   a = e^(-bT/m), g = (1 - a)/b, h = m g, l = (T - h)/b
///
/// lie inside the unit circle. Without b: KT/2 < B < 2m/T. With K = 0: B < b (1 + a)/(1 - a). An arm has a matrix in place of each
/// number, over the modes of its inertia and damping.
bool coupling_holds_robot(const Scene& scene, const CouplingOptions& coupling);

/// May the coupling drive the robot? It does not hold it, or would not with twice or half its damping: so far a contact, a limit or
/// another pose may take it.
bool coupling_may_drive_robot(const Scene& scene);

}  // namespace twoport
