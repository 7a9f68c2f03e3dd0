// Contacts that are held where a motion finds them.
#pragma once
#include "rolling.hpp"
#include "scene.hpp"

namespace condyn
{
/// The foot of a point on the line along n through the origin.
inline Vector3d onto(const Vector3d & n, const Vector3d & point) { return n.dot(point) * n; }

/// Gives constraints without an anchor the place where their bodies are, after forward kinematics.
inline void anchor(Scene & scene, const Data & data)
{
  for (int i : scene.unanchored)
  {
    Constraint & c = scene.constraints[i];
    const SE3 E1 = data.oMi[c.joint1] * c.placement1, E2 = data.oMi[c.joint2] * c.placement2;
    if (c.joint1 == 0) // a plane through a point of body 2
      c.placement1.translation() = onto(E1.rotation().col(2), E2.translation());
    else if (c.kind == Kind::roll)
    {
      const Touch at(c, E1.rotation().transpose() * E2.rotation(), Vector3d::Zero());
      c.placement2.translation() = onto(E2.rotation().col(2), E1.act(at.r.x));
    }
    else
      c.placement2 = E1;
    if (c.kind == Kind::held && !c.is_point() && c.size < 6)
      c.kind = Kind::cut; // an edge: off its anchor the world enters its rows
    c.anchored = true;
  }
  for (int i : scene.unanchored_plain)
  {
    PlainSpec & c = scene.plain_specs[i];
    c.placement2 = data.oMi[c.joint1] * c.placement1;
    c.anchored = true;
  }
}
} // namespace condyn
