// One constraint of a scene: its rows, and the joints and frames that they are between.
#pragma once
#include "pinocchio.hpp"

namespace condyn
{
/// How its rows are evaluated; the numbers are those of `condyn_pin/constraints/rows/bound.py`.
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
  int axis; // that a hinge turns about; the axle of a wheel, -1 of a ball
  bool is_hinge, is_slider;
  double length; // of a rod, the radius of what rolls [m]; the ratio of a coupling
  double offset; // of a coupling
  int q_a, q_b, v_a, v_b; // where q and v hold the joints of a coupling

  bool is_scalar() const { return kind == Kind::rod || kind == Kind::coupling; }
  /// Which of the components that its kind has a row is.
  int component(int row) const { return is_scalar() ? 0 : selection[row]; }
  bool is_point() const { return size == 3 && selection[0] == 0 && selection[2] == 2; }
};
} // namespace condyn
