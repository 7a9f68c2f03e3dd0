// What may touch: points over planes, stops of joints, dry friction of joints; their gaps and rows.
//
//   gap = n . (p - o) - radius,    J = E^T (J_v - [contact point] J_w),    contact point = p - radius n
//
// p the middle of a point, o and E = (t1, t2, n) of its plane. Cones come first, three rows each, then
// half-lines, then intervals. `condyn_pin/constraints/contacts` has the same in Python.
#pragma once
#include "scene.hpp"

namespace condyn
{
/// A contact point of one body over a plane of another.
struct ContactPoint
{
  int joint, ground; // 0 is the world
  Vector3d centre; // on the joint [m]
  double radius; // [m]
  SE3 plane; // on the ground, z out of it
  double friction;
};

/// An end of the range of a joint, sign (q - limit) >= 0.
struct Stop
{
  int at_q, at_v;
  double sign, limit; // [rad, m]
};

/// Dry friction along a coordinate of v, |force| <= limit.
struct Dry
{
  int at_v;
  double limit; // [N m, N]
};

class Candidates
{
public:
  Candidates(
    const Model & model, const std::vector<ContactPoint> & touches, const std::vector<Stop> & stops,
    const std::vector<Dry> & dry);

  int cones() const { return int(touches.size()); }
  int with_gaps() const { return int(touches.size() + stops.size()); }
  int count() const { return with_gaps() + int(dry.size()); }
  int rows() const { return 3 * cones() + int(stops.size() + dry.size()); }
  int size(int candidate) const { return candidate < cones() ? 3 : 1; }
  int first(int candidate) const { return candidate < cones() ? 3 * candidate : 2 * cones() + candidate; }
  /// The row along which the gap of a candidate changes.
  int normal(int candidate) const { return first(candidate) + size(candidate) - 1; }

  /// Signed distances of what has a gap [m, rad], from placements at q.
  void gaps(const Data & data, const VectorXd & q, VectorXd & gaps) const;
  /// Those over planes alone.
  void heights(const Data & data, VectorXd & gaps) const;
  /// Rows of all candidates, from placements and Jacobians.
  void rows(const Data & data, MatrixXd & J) const;
  /// The row of a touch along its normal, from placements and Jacobians.
  void normal_row(int touch, const Data & data, Eigen::Ref<Eigen::RowVectorXd, 0, Eigen::InnerStride<>> J) const;
  /// Adds forces of all candidates to the wrenches on the joints, and to `torque` those along joints.
  void push(const Data & data, const VectorXd & lam, Forces & on_joint, VectorXd & torque) const;

  std::vector<ContactPoint> touches;
  std::vector<Stop> stops;
  std::vector<Dry> dry;

  /// Where a point touches, from placements.
  struct Place
  {
    Matrix3d E; // t1, t2, n in the world
    Vector3d point;
    double gap;
  };
  static Place place(const ContactPoint & touch, const Data & data);

private:
  std::vector<std::vector<std::pair<int, double>>> moves_; // of each touch: columns that move it, or its ground
};
} // namespace condyn
