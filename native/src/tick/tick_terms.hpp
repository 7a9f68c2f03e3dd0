// The terms of the equations at the state of a tick, and what tasks read of the robot there.
#pragma once
#include "jacobian.hpp"
#include "rows.hpp"

namespace condyn
{
class TickTerms
{
public:
  explicit TickTerms(const Scene & scene);

  /// M and J.
  void place(const VectorXd & q);
  /// h, and what rows have to be; after `place`.
  void move(const VectorXd & v);

  /// J, Jdot v and the velocity of the centre of mass; its place is returned.
  Vector3d center_of_mass(MatrixXd & J, Vector3d & velocity, Vector3d & drift);
  /// The same of the angular momentum about it, which is its own velocity.
  Vector3d angular_momentum(MatrixXd & J, Vector3d & drift);
  /// What is left of the way from q to q_r, by entries of v.
  VectorXd way_to(const VectorXd & q_r) const;

  const Scene & scene;
  Data data; // kinematics with a = 0
  MatrixXd M, J;
  VectorXd h, wanted; // wanted: a_ref - gamma
  VectorXd q, v;

private:
  Rows rows_;
  std::vector<Moved> moved_; // of each constraint
  const VectorXd still_;
};
} // namespace condyn
