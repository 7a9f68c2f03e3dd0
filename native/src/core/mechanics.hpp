// The algorithms of Pinocchio that a step with contacts calls: compiled once, in a file of their own.
#pragma once
#include "scene.hpp"

namespace condyn
{
/// A model with memory for its algorithms.
class Mechanics
{
public:
  explicit Mechanics(const Model & model) : model(model), data(model) {}

  /// M with both triangles; placements and Jacobians of the joints as well.
  void mass(const VectorXd & q, MatrixXd & M);
  /// h(q, v).
  const VectorXd & bias(const VectorXd & q, const VectorXd & v);
  /// Placements and Jacobians of the joints.
  void jacobians(const VectorXd & q);
  /// Placements of the joints.
  void place(const VectorXd & q);
  /// Placements, velocities and accelerations of the joints.
  void move(const VectorXd & q, const VectorXd & v, const VectorXd & a);
  /// M a + h - sum J^T f, f in the axes of each joint.
  const VectorXd & inverse_dynamics(const VectorXd & q, const VectorXd & v, const VectorXd & a, const Forces & f);
  void integrate(const VectorXd & q, const VectorXd & along, VectorXd & moved);
  /// The move from q0 to q1.
  VectorXd difference(const VectorXd & q0, const VectorXd & q1);
  /// The end of a move by its start, and by the move (nv, nv).
  void integrate_partials(const VectorXd & q, const VectorXd & along, MatrixXd & by_start, MatrixXd & by_move);

  const Model & model;
  Data data;
};
} // namespace condyn
