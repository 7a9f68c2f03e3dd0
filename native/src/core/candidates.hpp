// What may touch: points over planes, shapes that meet, stops of joints, dry friction of joints; their gaps and rows.
//
//   gap = n . (p - o) - radius,    J = E^T (J_v - [contact point] J_w),    contact point = p - radius n
//
// p the middle of a point, o and E = (t1, t2, n) of its plane. Cones come first, three rows each, those over planes
// and then those of pairs of shapes, then half-lines, then intervals. `condyn_pin/constraints/contacts` has the same
// in Python.
#pragma once
#include "pairs.hpp"
#include "scene.hpp"
#include <algorithm>

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
    const Model & model, const std::vector<ContactPoint> & touches, const std::vector<Pair> & pairs,
    const std::vector<Stop> & stops, const std::vector<Dry> & dry);

  int over_planes() const { return int(touches.size()); }
  int cones() const { return int(moves_.size()); }
  int with_gaps() const { return cones() + int(stops.size()); }
  int count() const { return with_gaps() + int(dry.size()); }
  int rows() const { return 3 * cones() + int(stops.size() + dry.size()); }
  /// Joints that carry the two sides of a cone, the body and its ground.
  const std::pair<int, int> & sides(int cone) const { return sides_[cone]; }
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

  double friction(int cone) const;

  std::vector<ContactPoint> touches;
  std::vector<Pair> pairs;
  std::vector<Stop> stops;
  std::vector<Dry> dry;
  /// Where the cones of each pair of shapes begin that meet in more points than one, and where they end.
  std::vector<std::pair<int, int>> several;

  /// Where a point touches, from placements.
  struct Place
  {
    Matrix3d E; // t1, t2, n in the world
    Vector3d point;
    double gap;
  };
  static Place place(const ContactPoint & touch, const Data & data);
  static Place place(const Meeting & at);

private:
  void add_cone(const Model & model, int joint, int ground);
  /// Where all cones are, one after the other.
  template<typename F>
  void each_place(const Data & data, const F & tell) const
  {
    int cone = 0;
    for (const ContactPoint & touch : touches)
      tell(cone++, place(touch, data));
    for (const Pair & pair : pairs)
    {
      const Meetings found = pair.meet(data);
      for (int k = 0, there = int(found.size()); k < pair.places(); ++k)
      {
        Place at = place(found[std::min(k, there - 1)]);
        if (k >= there)
          at.gap = INFINITY;
        tell(cone++, at);
      }
    }
  }

  std::vector<std::pair<int, int>> sides_; // joints that carry the two sides of each cone
  std::vector<std::vector<std::pair<int, double>>> moves_; // of each cone: columns that move it, or its ground
};
} // namespace condyn
