// Shapes of two bodies that may meet, each with a fixed number of places for the points where they do.
//
// A place without a point has an infinite gap, and the rows of the last one that has. Shapes that are further apart
// than their own sizes are taken for the balls round them. `condyn_pin/constraints/contacts/candidates.py` has the same
// in Python.
#pragma once
#include "meetings.hpp"

namespace condyn
{
struct Pair
{
  int joint, ground; // 0 is the world
  SE3 placement, ground_placement; // of the shapes on them
  Shape shape, ground_shape;
  double friction;

  int places() const { return most_meetings(shape, ground_shape); }

  SE3 one(const Data & data) const { return data.oMi[joint] * placement; }
  SE3 two(const Data & data) const { return data.oMi[ground] * ground_placement; }
  /// Whether shapes at two places are taken for balls.
  bool are_balls(const SE3 & one, const SE3 & two) const
  {
    return (one.translation() - two.translation()).norm() > 2.0 * (shape.reach + ground_shape.reach);
  }

  /// Where they meet, from placements; one at least, and no more than there are places.
  Meetings meet(const Data & data) const
  {
    const SE3 at = one(data), beside = two(data);
    if (!are_balls(at, beside))
      return meetings(shape.placed(at), ground_shape.placed(beside));
    const auto [distance, normal] = Length(at.translation() - beside.translation());
    return {{distance - shape.reach - ground_shape.reach, at.translation() - shape.reach * normal, normal}};
  }
};
} // namespace condyn
