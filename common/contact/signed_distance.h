#pragma once

#include <Eigen/Core>

namespace twoport {

/// A point or a vector in D = 1 or 3 dimensions, world axes.
template <int D>
using Point = Eigen::Matrix<double, D, 1>;

/// Index of a smooth part of a shape, from 0.
using Feature = int;
inline constexpr Feature kNearest = -1;  ///< the one nearest to the point
inline constexpr Feature kNone = -2;     ///< none: the contact is ignored

/// Signed distance from a point to a surface [m], negative inside, and its gradient there, the outward normal. Both come
/// from one function, so that the elastic force has a potential.
template <int D>
struct SignedDistance {
  double distance;
  Point<D> normal;
  Feature feature = 0;
};

}  // namespace twoport
