// A spring and a damper in parallel, between the origins of two frames: how far these are apart.
//
//   f = k (l - l0) + c l',    E = k (l - l0)^2 / 2,    l = |r|
#pragma once
#include "pinocchio.hpp"

namespace condyn
{
/// A spring along the coordinate of a joint.
struct JointSpring
{
  int at_q, at_v; // where q and v hold it
  double stiffness, reference;
};

struct SpringDamper
{
  int joint_a, joint_b; // 0 is the world
  Vector3d a, b; // the origins on them [m]
  double stiffness, damping, rest; // [N/m], [N s/m], [m]
};

/// The line between the ends of one, with the joints placed.
struct Line
{
  Vector3d at_a, at_b, n; // in the world; n from a to b, zero where the ends coincide
  double length;

  Line(const SpringDamper & spring, const Data & data)
  : at_a(data.oMi[spring.joint_a].act(spring.a)), at_b(data.oMi[spring.joint_b].act(spring.b)), n(at_b - at_a)
  , length(n.norm())
  {
    n *= coincide() ? 0.0 : 1.0 / length;
  }

  /// Whether the distance is rounding: there is no direction.
  bool coincide() const { return !(length > nothing); }
  /// Stiffness across the line [N/m]: what holds the ends there, and none of what pushes them apart.
  double across(const SpringDamper & spring) const
  {
    return std::max(spring.stiffness * (1 - spring.rest / std::max(length, nothing)), 0.0);
  }

private:
  static constexpr double nothing = 1e-12; // as `_COINCIDE` [m]
};

inline double energy(const SpringDamper & spring, const Line & line)
{
  return spring.stiffness * (line.length - spring.rest) * (line.length - spring.rest) / 2;
}

/// What the damper takes, c l'^2 [W], with the velocities of the joints.
inline double dissipation(const SpringDamper & spring, const Line & line, const Data & data)
{
  const auto velocity = [&data](int joint, const Vector3d & point) -> Vector3d {
    if (!joint)
      return Vector3d::Zero();
    const Motion & v = data.v[joint];
    return data.oMi[joint].rotation() * (v.linear() + v.angular().cross(point));
  };
  const double rate = line.n.dot(velocity(spring.joint_b, spring.b) - velocity(spring.joint_a, spring.a));
  return spring.damping * rate * rate;
}
} // namespace condyn
