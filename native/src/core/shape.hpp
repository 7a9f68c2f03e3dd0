// A shape as its core, a point, a segment or a polytope, and the ball that each point of the core carries.
#pragma once
#include "pinocchio.hpp"
#include <array>
#include <cmath>

namespace condyn
{
using Edge = std::array<int, 2>; // its two ends
using Edges = std::vector<Edge>;
using Points = Eigen::Matrix3Xd;

constexpr double on_face = 1e-9; // how far beside a face, by the size of the shape, a point is on it: `ON_FACE`

/// A vector as its length and its direction; that of zero is z.
struct Length
{
  double length;
  Vector3d along;

  Length(double length, const Vector3d & along) : length(length), along(along) {}
  explicit Length(const Vector3d & x) : length(std::sqrt(x.squaredNorm())), along(Vector3d::UnitZ())
  {
    if (length > 0.0)
      along = x / length;
  }
};

struct Shape
{
  Points vertices; // [m]
  Edges edges;
  Points normals; // of the faces, outwards
  VectorXd heights; // of the faces along them [m]
  std::vector<std::vector<int>> loops; // the vertices of each face, one after the other around it
  Points directions; // along the edges, one for parallel ones
  double radius, size, reach; // of the skin, along a coordinate of its axes, of a point from the origin [m]

  bool is_point() const { return vertices.cols() == 1; }
  bool is_solid() const { return normals.cols() > 0; }

  /// In the world.
  Shape placed(const SE3 & at) const
  {
    Shape there = *this;
    there.vertices = (at.rotation() * vertices).colwise() + at.translation();
    there.normals = at.rotation() * normals;
    there.heights = heights + there.normals.transpose() * at.translation();
    there.directions = at.rotation() * directions;
    return there;
  }

  /// Whether a point of the plane of a face is on the core.
  bool holds(const Vector3d & point) const
  {
    return ((normals.transpose() * point - heights).array() <= on_face * size).all();
  }

  /// The signed distance of a point from the core, and the way there.
  Length away(const Vector3d & point) const
  {
    if (is_solid())
    {
      int face;
      const double height = (normals.transpose() * point - heights).maxCoeff(&face);
      const Vector3d normal = normals.col(face);
      if (height <= 0.0 || holds(point - height * normal))
        return {height, normal};
    }
    Vector3d least = point - vertices.col(0);
    double square = edges.empty() ? least.squaredNorm() : INFINITY;
    for (const Edge & edge : edges)
    {
      const Vector3d start = vertices.col(edge[0]), along = vertices.col(edge[1]) - start;
      const double share = (point - start).dot(along) / along.squaredNorm();
      const Vector3d off = point - start - std::min(std::max(share, 0.0), 1.0) * along;
      if (off.squaredNorm() < square)
        least = off, square = off.squaredNorm();
    }
    return Length(least);
  }
};
} // namespace condyn
