// What rolls: the lowest point of a wheel or of a ball, and the axes of its rows.
//
//   wheel with axle e    t = e x n / |e x n|    r = radius e x t
//   ball                 t = x of the plane     r = -radius n
//
// in the axes of the body, with n the normal. `condyn_pin/constraints/rows/special.py` has the rows,
// `constraints/partials/rows.py` how they change.
#pragma once
#include "constraint.hpp"

namespace condyn
{
/// A vector that turns with the state: itself, its rate, and how both change with one coordinate.
struct Turning
{
  Vector3d x, dot, x_q, dot_q;

  /// Of what is fixed in the world, seen by a body with the angular velocity w.
  static Turning in_world(const Vector3d & x, const Vector3d & w, const Vector3d & J_w, const Vector3d & w_q)
  {
    const Vector3d x_q = x.cross(J_w);
    return {x, x.cross(w), x_q, x.cross(w_q) - w.cross(x_q)};
  }
  Turning times(double factor) const { return {factor * x, factor * dot, factor * x_q, factor * dot_q}; }
  /// e x itself, e being fixed in the body.
  Turning crossed_by(const Vector3d & e) const { return {e.cross(x), e.cross(dot), e.cross(x_q), e.cross(dot_q)}; }
  Turning cross(const Turning & y) const
  {
    return {x.cross(y.x), dot.cross(y.x) + x.cross(y.dot), x_q.cross(y.x) + x.cross(y.x_q),
            dot_q.cross(y.x) + dot.cross(y.x_q) + x_q.cross(y.dot) + x.cross(y.dot_q)};
  }
  /// Over its length; zero where that vanishes, as of a wheel that lies flat.
  Turning unit() const
  {
    const double size = x.norm(), shrink = size > 1e-12 ? 1.0 / size : 0.0; // FLAT in Python
    const Vector3d u = shrink * x;
    const auto across = [&](const Vector3d & y) -> Vector3d { return shrink * (y - u * u.dot(y)); };
    const Vector3d u_q = across(x_q), u_dot = across(dot);
    const double along = u.dot(dot), along_q = dot.dot(u_q) + u.dot(dot_q);
    return {u, u_dot, u_q, shrink * (dot_q - u * along_q - along * u_q - u_dot * u.dot(x_q))};
  }
};

/// The lowest point, and the axes of the three rows: forward, sideways, off the plane.
struct Touch
{
  Turning r, axes[3];

  /// `R` turns vectors of the plane into the axes of the body, which turns with w; J_w and w_q are
  /// what a coordinate does to that.
  Touch(
    const Constraint & k, const Matrix3d & R, const Vector3d & w, const Vector3d & J_w = Vector3d::Zero(),
    const Vector3d & w_q = Vector3d::Zero())
  {
    const Turning n = Turning::in_world(R.col(2), w, J_w, w_q);
    const bool wheel = k.axis >= 0;
    const Vector3d e = wheel ? Vector3d(Vector3d::Unit(k.axis)) : Vector3d(Vector3d::Zero());
    const Turning t = wheel ? n.crossed_by(e).unit() : Turning::in_world(R.col(0), w, J_w, w_q);
    r = wheel ? t.crossed_by(e).times(k.length) : n.times(-k.length);
    axes[0] = t, axes[1] = n.cross(t), axes[2] = n;
  }

  /// The force of its rows, in the axes of the body.
  template<typename Three>
  Vector3d force(const Three & lam) const
  {
    return lam[0] * axes[0].x + lam[1] * axes[1].x + lam[2] * axes[2].x;
  }
};
} // namespace condyn
