// Where two shapes meet: points, normals and gaps of the features that face each other.
//
//   corner on face    gap = n . (corner - face),                  n of the face
//   edge on edge      gap = n . (point of A - point of B),        n = d_A x d_B
//   round on any      gap = |a - b| - radius_A - radius_B,        n along a - b
//
// n points from B to A. `condyn_pin/constraints/contacts/meetings.py` has the same in Python.
#pragma once
#include "shape.hpp"

namespace condyn
{
struct Meeting
{
  double gap; // [m]
  Vector3d point; // on the first shape, in the world [m]
  Vector3d normal; // from the second shape to the first
};
using Meetings = std::vector<Meeting>;

/// At how many points two shapes meet at most.
int most_meetings(const Shape & A, const Shape & B);

/// Where two shapes, placed in the world, meet. The least gap is the distance of the shapes; where they penetrate,
/// the least shift that takes them apart, negative.
Meetings meetings(const Shape & A, const Shape & B);
} // namespace condyn
