// What one coordinate does to the velocities and accelerations of the two ends of a constraint.
//
// Newton-Euler's derivatives leave, for every coordinate j and in the axes of the world, what it does
// to the velocity and the acceleration of all that it moves: J, dV/dq, dA/dq and dA/dv. Here they are
// seen from a frame.
#pragma once
#include "pinocchio.hpp"

namespace condyn
{
/// What one coordinate does to a frame, in the axes of c1.
struct Column
{
  Motion J, v_q, a_q, a_v;
};

/// One of the two ends: a frame on a body, at a point and in the axes of c1.
struct Body
{
  Motion v, a;

  /// Of the body of a joint, seen at a frame in the world.
  Body(const Data & data, int joint, const SE3 & seen_from)
  : v(joint ? seen_from.actInv(data.ov[joint]) : Motion(Motion::Zero()))
  , a(joint ? seen_from.actInv(data.oa[joint]) : Motion(Motion::Zero()))
  {}
  Vector3d classical() const { return a.linear() + v.angular().cross(v.linear()); }
  Vector3d classical_q(const Column & c) const
  {
    return c.a_q.linear() + v.angular().cross(c.v_q.linear()) - v.linear().cross(c.v_q.angular());
  }
  Vector3d classical_v(const Column & c) const
  {
    return c.a_v.linear() + v.angular().cross(c.J.linear()) - v.linear().cross(c.J.angular());
  }
};

/// A column of the world, seen from a frame.
inline Motion seen(const Data::Matrix6x & all, int j, const SE3 & from)
{
  return from.actInv(Motion(all.col(j).head<3>(), all.col(j).tail<3>()));
}

/// Of coordinate j, which moves a body with the velocity v; what turns with that body is taken off.
inline Column column(const Data & data, int j, const SE3 & from, const Motion & v)
{
  const Motion J = seen(data.J, j, from), v_q = seen(data.dVdq, j, from);
  return {J, v_q, seen(data.dAdq, j, from) - v.cross(v_q), seen(data.dAdv, j, from) - v.cross(J)};
}

inline Column slip_column(const Data & data, int j, const SE3 & from)
{
  const Motion zero(Motion::Zero());
  return {seen(data.J, j, from), seen(data.dVdq, j, from), zero, zero};
}

inline Column nothing()
{
  const Motion zero(Motion::Zero());
  return {zero, zero, zero, zero};
}
} // namespace condyn
