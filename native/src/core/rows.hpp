// The rows of a scene at a state: c, J v and J a + gamma, and lam as wrenches on the joints.
//
// With E1, E2 the frames c1, c2 in the world, R = R1^T R2, r = R1^T (p2 - p1), velocities and
// accelerations each in the axes of its own frame, those of points classical:
//
//   held   on the world, rows of c1 itself        J v = v1           J a + gamma = a1
//   ball   c = -R1^T (p2 - p1)                    J v = v1 - R v2    J a + gamma = a1 - R a2
//   weld   c = -log6(E1^-1 E2)                    J v = v1 - X v2    J a + gamma = a1 - X a2 + slip x X v2
//   cut    s = v1 + w1 x r - R v2 = -r',          s' = a1 - R a2 + alpha1 x r + w1 x (w1 x r - 2 s)
//          w1 - R w2,                             alpha1 - R alpha2 + w1 x R w2
//   cross  (of a cut) e . u,               e x u . (w1 - R w2),     u = R e_b
//   rod    c = L - |r|,    J v = n . s,           J a + gamma = n . s' - (|s|^2 - (n . s)^2) / |r|
//
// Rows that are driven follow s(t): c - s, J v - s' and J a + gamma - s'' stand for the three.
// `condyn_pin/constraints/rows` has the same in Python, where each is derived.
#pragma once
#include "rolling.hpp"
#include "scene.hpp"
#include <cmath>

namespace condyn
{
/// A frame on a joint, after forward kinematics.
struct End
{
  SE3 E; // in the world
  Motion v, a; // in its own axes, spatial

  End(const Data & data, int joint, const SE3 & placement)
  : E(data.oMi[joint] * placement)
  , v(joint ? placement.actInv(data.v[joint]) : Motion(Motion::Zero()))
  , a(joint ? placement.actInv(data.a[joint]) : Motion(Motion::Zero()))
  {}
  Vector3d classical() const { return a.linear() + v.angular().cross(v.linear()); }
};

/// The rows of all constraints, without Baumgarte's terms.
struct Rows
{
  VectorXd c, velocity, acceleration;

  explicit Rows(int m) : c(VectorXd::Zero(m)), velocity(c), acceleration(c) {}

  /// After forward kinematics with (q, v, a).
  void evaluate(const Scene & scene, const Data & data, const VectorXd & q, const VectorXd & v, const VectorXd & a)
  {
    for (const auto & k : scene.constraints)
    {
      switch (k.kind)
      {
      case Kind::held: held(k, data); break;
      case Kind::ball: ball(k, data); break;
      case Kind::weld: weld(k, data); break;
      case Kind::cut: cut(k, data); break;
      case Kind::rod: rod(k, data); break;
      case Kind::roll: roll(k, data); break;
      case Kind::coupling:
        c[k.first] = q[k.q_a] - k.length * q[k.q_b] - k.offset;
        velocity[k.first] = v[k.v_a] - k.length * v[k.v_b];
        acceleration[k.first] = a[k.v_a] - k.length * a[k.v_b];
      }
      if (k.sign < 0)
        for (auto * part : {&c, &velocity, &acceleration})
          part->segment(k.first, k.size) *= -1.0;
    }
    if (scene.wanted.size())
      c -= scene.wanted.col(0), velocity -= scene.wanted.col(1), acceleration -= scene.wanted.col(2);
  }

private:
  void put(const Constraint & k, const Vector6d & gap, const Vector6d & slip, const Vector6d & rate)
  {
    for (int i = 0; i < k.size; ++i)
    {
      c[k.first + i] = gap[k.selection[i]];
      velocity[k.first + i] = slip[k.selection[i]];
      acceleration[k.first + i] = rate[k.selection[i]];
    }
  }

  void held(const Constraint & k, const Data & data)
  {
    const End one(data, k.joint1, k.placement1);
    Vector6d gap = Vector6d::Zero(), rate = one.a.toVector();
    if (k.is_point())
      rate.head<3>() = one.classical();
    if (k.anchored && k.is_point())
      gap.head<3>() = -one.E.actInv(k.placement2.translation());
    else if (k.anchored)
      gap = pinocchio::log6(k.placement2.actInv(one.E)).toVector();
    put(k, gap, one.v.toVector(), rate);
  }

  void ball(const Constraint & k, const Data & data)
  {
    const End one(data, k.joint1, k.placement1), two(data, k.joint2, k.placement2);
    const Matrix3d R = one.E.rotation().transpose() * two.E.rotation();
    c.segment<3>(k.first) = -(one.E.rotation().transpose() * (two.E.translation() - one.E.translation()));
    velocity.segment<3>(k.first) = one.v.linear() - R * two.v.linear();
    acceleration.segment<3>(k.first) = one.classical() - R * two.classical();
  }

  void weld(const Constraint & k, const Data & data)
  {
    const End one(data, k.joint1, k.placement1), two(data, k.joint2, k.placement2);
    const SE3 between = one.E.actInv(two.E);
    const Motion v2 = between.act(two.v), slip = one.v - v2;
    c.segment<6>(k.first) = -pinocchio::log6(between).toVector();
    velocity.segment<6>(k.first) = slip.toVector();
    acceleration.segment<6>(k.first) = (one.a - between.act(two.a) + slip.cross(v2)).toVector();
  }

  void cut(const Constraint & k, const Data & data)
  {
    const End one(data, k.joint1, k.placement1), two(data, k.joint2, k.placement2);
    const SE3 between = one.E.actInv(two.E);
    const Matrix3d & R = between.rotation();
    const Vector3d r = between.translation(), w1 = one.v.angular(), w2 = R * two.v.angular();
    Vector6d gap = Vector6d::Zero(), slip, rate;
    slip.head<3>() = one.v.linear() + w1.cross(r) - R * two.v.linear();
    slip.tail<3>() = w1 - w2;
    rate.head<3>() = one.classical() - R * two.classical() + one.a.angular().cross(r)
      + w1.cross(w1.cross(r) - 2 * slip.head<3>());
    rate.tail<3>() = one.a.angular() - R * two.a.angular() + w1.cross(w2);
    if (k.anchored)
    {
      gap.head<3>() = -r;
      if (k.is_slider)
        gap.tail<3>() = -pinocchio::log3(R);
      else if (k.is_hinge)
        gap.tail<3>() = turn_off(R, k.axis);
    }
    if (k.is_cross())
    {
      const Cross cross(k, R);
      rate[3] = cross.w.dot(rate.tail<3>()) + cross.rate(slip.tail<3>()).dot(slip.tail<3>());
      slip[3] = cross.w.dot(slip.tail<3>());
      gap[3] = cross.e.dot(cross.u);
    }
    put(k, gap, slip, rate);
  }

  /// The turn that brings e back onto R e.
  static Vector3d turn_off(const Matrix3d & R, int axis)
  {
    const Vector3d e = Vector3d::Unit(axis), turned = R * e;
    Vector3d across = turned.cross(e);
    const double cosine = turned.dot(e), sine = across.norm();
    // an axis that points backwards is half a turn off, about any axis across
    if (!(sine > 0))
      across = cosine < 0 ? Vector3d(Vector3d::Unit((axis + 1) % 3)) : Vector3d(Vector3d::Zero());
    return std::atan2(sine, cosine) / (sine > 0 ? sine : 1.0) * across;
  }

  void rod(const Constraint & k, const Data & data)
  {
    const End one(data, k.joint1, k.placement1), two(data, k.joint2, k.placement2);
    const Vector3d r = two.E.translation() - one.E.translation();
    const Vector3d s = one.E.rotation() * one.v.linear() - two.E.rotation() * two.v.linear();
    const Vector3d s_dot = one.E.rotation() * one.classical() - two.E.rotation() * two.classical();
    const double distance = r.norm(), per_distance = 1.0 / std::max(distance, 1e-300);
    const double along = s.dot(r) * per_distance;
    c[k.first] = k.length - distance;
    velocity[k.first] = along;
    acceleration[k.first] = (s_dot.dot(r) - s.dot(s) + along * along) * per_distance;
  }

  void roll(const Constraint & k, const Data & data)
  {
    const End one(data, k.joint1, k.placement1);
    const SE3 plane = one.E.actInv(k.placement2);
    const Vector3d w = one.v.angular();
    const Touch at(k, plane.rotation(), w);
    const Vector3d s = one.v.linear() + w.cross(at.r.x);
    const Vector3d s_dot = one.a.linear() + one.a.angular().cross(at.r.x) + w.cross(at.r.dot);
    Vector6d gap = Vector6d::Zero(), slip = gap, rate = gap;
    for (int i = 0; i < 3; ++i)
    {
      slip[i] = at.axes[i].x.dot(s);
      rate[i] = at.axes[i].x.dot(s_dot) + at.axes[i].dot.dot(s);
    }
    if (k.anchored)
      gap[2] = at.axes[2].x.dot(at.r.x - plane.translation());
    put(k, gap, slip, rate);
  }
};

/// Adds lam, in the axes of each constraint, to the wrenches on the joints; J^T lam of couplings,
/// which is no wrench, to `torque`.
inline void add_wrenches(
  const Scene & scene, const Data & data, const VectorXd & lam, Forces & on_joint, VectorXd & torque)
{
  for (const auto & k : scene.constraints)
  {
    if (k.kind == Kind::coupling)
    {
      torque[k.v_a] += lam[k.first];
      torque[k.v_b] -= k.length * lam[k.first];
      continue;
    }
    Vector6d six = Vector6d::Zero();
    Force one(Force::Zero()), two(Force::Zero());
    SE3 between = SE3::Identity();
    if (k.kind != Kind::held)
      between = (data.oMi[k.joint1] * k.placement1).actInv(data.oMi[k.joint2] * k.placement2);
    const Matrix3d & R = between.rotation();
    if (k.kind == Kind::rod)
    {
      const Vector3d r = between.translation();
      six.head<3>() = k.sign * lam[k.first] / std::max(r.norm(), 1e-300) * r;
    }
    else
      for (int i = 0; i < k.size; ++i)
        six[k.selection[i]] = k.sign * lam[k.first + i];
    if (k.is_cross())
      six.tail<3>() = (six[3] * Cross(k, R).w).eval();
    if (k.kind == Kind::roll)
    {
      const Touch at(k, R, Vector3d::Zero());
      const Vector3d force = at.force(six);
      six << force, at.r.x.cross(force);
    }
    one.toVector() = six;
    if (k.kind == Kind::weld)
      two = between.actInv(one);
    else if (k.kind != Kind::held)
    {
      two.linear() = R.transpose() * one.linear();
      two.angular() = R.transpose() * one.angular();
    }
    if (k.kind == Kind::cut)
      one.angular() += between.translation().cross(one.linear());
    if (k.joint1)
      on_joint[k.joint1] += k.placement1.act(one);
    if (k.joint2)
      on_joint[k.joint2] -= k.placement2.act(two);
  }
}
} // namespace condyn
