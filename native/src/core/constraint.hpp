// One constraint of a scene: its rows, and the joints and frames that they are between.
#pragma once
#include "pinocchio.hpp"

namespace condyn
{
/// How its rows are evaluated; `CompiledRows` in `condyn_pin/constraints/rows/bound.py` names them.
enum class Kind { held, ball, weld, cut, rod, coupling, roll };

struct Constraint
{
  Kind kind;
  int first, size; // rows among those of the scene
  int joint1, joint2;
  SE3 placement1, placement2; // of c1 and c2 on them
  std::vector<int> selection; // of the six rows of the slip; of what rolls, of its three
  bool anchored;
  double sign; // +1 if lam acts on joint 1
  int axis; // that a hinge turns about; the axle of a wheel, -1 of a ball; of c1 in a cross
  int other_axis; // of c2, which the row behind the shifts of a cross keeps across `axis`; -1 for all else
  bool is_hinge, is_slider;
  double length; // of a rod, the radius of what rolls [m]; the ratio of a coupling
  double offset; // of a coupling
  int q_a, q_b, v_a, v_b; // where q and v hold the joints of a coupling

  bool is_scalar() const { return kind == Kind::rod || kind == Kind::coupling; }
  bool is_cross() const { return other_axis >= 0; }
  /// Which of the components that its kind has a row is.
  int component(int row) const { return is_scalar() ? 0 : selection[row]; }
  bool is_point() const { return size == 3 && selection[0] == 0 && selection[2] == 2; }
};

/// The row of a cross, e . u = 0 with u = R e_b: w . s_ang with w = e x u, as frames move by s.
struct Cross
{
  Vector3d e, u, w;

  Cross(const Constraint & k, const Matrix3d & R)
  : e(Vector3d::Unit(k.axis)), u(R.col(k.other_axis)), w(e.cross(u))
  {}
  /// The rate of w, as u' = u x s_ang.
  Vector3d rate(const Vector3d & turning) const { return e.cross(u.cross(turning)); }
};
} // namespace condyn
