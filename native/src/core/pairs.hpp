// Shapes of two bodies that may meet, each with a fixed number of places for the points where they do.
//
// A place without a point has an infinite gap, and the rows of the last one that has. Shapes that are further apart
// than their own sizes are taken for the balls round them. `condyn_pin/constraints/contacts/pairs.py` has the same
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

  /// Where they meet, from placements; one at least, and no more than there are places.
  Meetings meet(const Data & data) const
  {
    const SE3 one = data.oMi[joint] * placement, two = data.oMi[ground] * ground_placement;
    const Length apart(one.translation() - two.translation());
    const double reach = shape.reach + ground_shape.reach;
    if (apart.length > 2.0 * reach)
      return {{apart.length - reach, one.translation() - shape.reach * apart.along, apart.along}};
    return meetings(shape.placed(one), ground_shape.placed(two));
  }
};
} // namespace condyn
