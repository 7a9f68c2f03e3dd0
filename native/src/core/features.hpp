// Which features of two shapes meet at a point, and how it moves with the bodies.
//
// Points a of A and b of B are on a corner, an edge or a face each, in whose directions d they slide along their
// bodies; the rest of what is across n is across a - b = G n, the gap between the cores. A twist (v, w) of A past B,
// with v_a = v + w x a the velocity that A has at a, gives
//
//   d . n' = d . (w x n),  0,  d . v_a / G     along A's directions, B's, and what is across both
//   n' = U (w x n) + R v_a,    a' = v_a - U^T (v_a - G n')
//
// with U and R the sums of c d^T over A's directions and of c d^T / G over the rest, c . d = 1 and c across all
// others. Where corners and edges meet that are on the rim of a face along n, that face counts.
// `condyn_pin/constraints/partials/contacts.py` has the same in Python.
#pragma once
#include "shape.hpp"
#include <optional>

namespace condyn
{
/// How the point of A and the normal turn: U, R and G, as above. A corner on a face of B has neither U nor R.
struct Sliding
{
  Matrix3d U = Matrix3d::Zero(), R = Matrix3d::Zero(); // [1/m]
  double between = 0; // G [m]
};

/// What of a core has a point: a corner, an edge with its direction, a face, or nothing.
struct Feature
{
  enum Kind { corner, edge, face, none } kind;
  Vector3d along = Vector3d::Zero();
};

inline Matrix3d across(const Vector3d & normal) { return Matrix3d::Identity() - normal * normal.transpose(); }

/// The smallest feature of a core that has a point.
inline Feature feature_at(const Shape & core, const Vector3d & point)
{
  const double off = on_face * core.size;
  if (core.is_point() || (core.vertices.colwise() - point).colwise().norm().minCoeff() <= off)
    return {Feature::corner};
  double least = INFINITY;
  Vector3d along;
  for (const Edge & edge : core.edges)
  {
    const Vector3d away = point - core.vertices.col(edge[0]);
    const Vector3d d = core.vertices.col(edge[1]) - core.vertices.col(edge[0]);
    const double share = away.dot(d) / d.squaredNorm();
    const double apart = (away - std::min(std::max(share, 0.0), 1.0) * d).norm();
    if (apart < least)
      least = apart, along = d;
  }
  if (least <= off)
    return {Feature::edge, along.normalized()};
  if (core.is_solid() && (core.normals.transpose() * point - core.heights).cwiseAbs().minCoeff() <= off
      && core.holds(point))
    return {Feature::face};
  return {Feature::none};
}

/// Whether a point is in the plane of a face with a normal.
inline bool has_face(const Shape & core, const Vector3d & point, const Vector3d & normal)
{
  for (Eigen::Index i = 0; i < core.normals.cols(); ++i)
    if ((core.normals.col(i) - normal).cwiseAbs().maxCoeff() <= on_face
        && std::abs(core.normals.col(i).dot(point) - core.heights[i]) <= on_face * core.size)
      return true;
  return false;
}

/// The nearest points of two balls, `between` their middles.
inline Sliding of_balls(const Vector3d & normal, double between)
{
  return {Matrix3d::Zero(), across(normal) / between, between};
}

/// How a point of the core of A moves that meets B; none where that is in doubt.
inline std::optional<Sliding> sliding(
  const Shape & A, const Shape & B, const Vector3d & a, const Vector3d & normal, double between)
{
  const Vector3d b = a - between * normal;
  const Feature one = feature_at(A, a), two = feature_at(B, b);
  const Matrix3d nothing = Matrix3d::Zero();
  if (one.kind == Feature::corner && (two.kind == Feature::face || has_face(B, b, normal)))
    return Sliding{nothing, nothing, between};
  if (two.kind == Feature::corner && (one.kind == Feature::face || has_face(A, a, -normal)))
    return Sliding{across(normal), nothing, between};
  if (one.kind == Feature::edge && two.kind == Feature::edge)
  {
    const Vector3d c = two.along.cross(normal);
    return Sliding{c / c.dot(one.along) * one.along.transpose(), nothing, between};
  }
  if (one.kind + two.kind > Feature::edge || between <= on_face * std::max(A.size, B.size))
    return std::nullopt;
  const Vector3d along = one.along + two.along; // of the only edge
  const Matrix3d rest = across(normal) - along * along.transpose();
  return Sliding{one.along * one.along.transpose(), rest / between, between};
}
} // namespace condyn
