// Bodies that float: their velocities in axes that stand still within a step.
//
// Along a straight path a body turns by dt w. Its own axes turn with it, so that a velocity which stays is
// another in them at the end, and Pinocchio's integration bends the path of its origin. With y = (x, theta) and
// V = (U, w) the coordinates of a step, and E = exp(theta),
//
//   v = (E^T U, w),    U' = E (a_u + w x u)
#pragma once
#include "mechanics.hpp"
#include <utility>

namespace condyn
{
class Floating
{
public:
  explicit Floating(const Model & model)
  {
    for (int j = 1; j < model.njoints; ++j)
      if (model.nvs[j] == 6)
        bodies_.emplace_back(model.idx_qs[j], model.idx_vs[j]);
  }

  bool none() const { return bodies_.empty(); }

  /// The velocity at the end of a step along v, in the axes of that end.
  VectorXd turned(const VectorXd & v, double dt) const
  {
    VectorXd found = v;
    for (const auto & [at_q, i] : bodies_)
      found.segment<3>(i) = pinocchio::exp3(Vector3d(-dt * v.segment<3>(i + 3))) * v.segment<3>(i);
    return found;
  }

  /// w x v: the acceleration that is only the turning of the axes.
  VectorXd turning(const VectorXd & v) const
  {
    VectorXd found = VectorXd::Zero(v.size());
    for (const auto & [at_q, i] : bodies_)
      found.segment<3>(i) = Vector3d(v.segment<3>(i + 3)).cross(Vector3d(v.segment<3>(i)));
    return found;
  }

  /// Velocities of a step, or what they change at, in the axes that bodies have at y.
  VectorXd own(const VectorXd & y, const VectorXd & V) const
  {
    VectorXd found = V;
    for (const auto & [at_q, i] : bodies_)
      found.segment<3>(i) = pinocchio::exp3(Vector3d(-y.segment<3>(i + 3))) * V.segment<3>(i);
    return found;
  }

  /// V' where bodies have the velocity v and the acceleration a at y.
  VectorXd carried(const VectorXd & y, const VectorXd & v, const VectorXd & a) const
  {
    VectorXd found = a;
    for (const auto & [at_q, i] : bodies_)
    {
      const Vector3d straight = a.segment<3>(i) + Vector3d(v.segment<3>(i + 3)).cross(Vector3d(v.segment<3>(i)));
      found.segment<3>(i) = pinocchio::exp3(Vector3d(y.segment<3>(i + 3))) * straight;
    }
    return found;
  }

  /// Takes rows at the end of a step along v to the axes of its beginning.
  void rows_before(MatrixXd & J, const VectorXd & v, double dt) const
  {
    for (const auto & [at_q, i] : bodies_)
    {
      const Matrix3d turn = pinocchio::exp3(Vector3d(-dt * v.segment<3>(i + 3)));
      J.middleCols<3>(i) = (J.middleCols<3>(i) * turn).eval();
      J.middleCols<3>(i + 3) = (J.middleCols<3>(i + 3) * turn).eval();
    }
  }

  /// q (+) along, with the origins of the bodies on straight lines.
  void integrate(Mechanics & mechanics, const VectorXd & q, const VectorXd & along, VectorXd & moved) const
  {
    mechanics.integrate(q, along, moved);
    straighten(q, along, moved);
  }

  /// Puts the origins of the bodies of q (+) along onto straight lines.
  void straighten(const VectorXd & q, const VectorXd & along, VectorXd & moved) const
  {
    for (const auto & [k, i] : bodies_)
    {
      const Eigen::Quaterniond turn(q[k + 6], q[k + 3], q[k + 4], q[k + 5]);
      moved.segment<3>(k) = q.segment<3>(k) + turn * Vector3d(along.segment<3>(i));
    }
  }

private:
  std::vector<std::pair<int, int>> bodies_; // where q and v hold them
};
} // namespace condyn
