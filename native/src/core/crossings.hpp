// Where edges of two shapes cross, seen along what is across both.
//
//   (a + s d - b - t e) . d = 0 = (a + s d - b - t e) . e,    0 <= s, t <= 1
//
// a and b where the edges start, d and e the ways to their ends.
#pragma once
#include "shape.hpp"
#include <algorithm>

namespace condyn
{
// sine of the angle between edges, and where rounding alone is parallel: `PARALLEL` and `FLAT` of Python
constexpr double parallel = 1e-3, flat = 1e-6;

/// Where lines along edges that cross are nearest, and the edges.
struct Crossing
{
  Vector3d p, q, d, e;
};

inline std::vector<Crossing> crossings(
  const Shape & A, const Edges & of_A, const Shape & B, const Edges & of_B, double least = parallel)
{
  std::vector<Crossing> found;
  for (const Edge & one : of_A)
    for (const Edge & two : of_B)
    {
      const Vector3d a = A.vertices.col(one[0]), d = A.vertices.col(one[1]) - a;
      const Vector3d b = B.vertices.col(two[0]), e = B.vertices.col(two[1]) - b, apart = a - b;
      const double dd = d.dot(d), ee = e.dot(e), de = d.dot(e), da = d.dot(apart), ea = e.dot(apart);
      const double area = dd * ee - de * de;
      if (!(area > least * least * dd * ee))
        continue;
      const double s = (de * ea - ee * da) / area, t = (dd * ea - de * da) / area;
      if (std::max(std::abs(s - 0.5), std::abs(t - 0.5)) <= 0.5 + on_face)
        found.push_back({a + s * d, b + t * e, d, e});
    }
  return found;
}
} // namespace condyn
