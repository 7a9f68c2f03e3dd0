// How the rows of contact points change with q.
//
// A point P of a body on its ground has the rows d . (S_l + S_a x P) of each column S = (S_l, S_a) that moves body or
// ground, in the axes of the world and at its origin. With b and g one where coordinate j moves the body and the
// ground, a step of it carries along what is above it,
//
//   P' = g (S_l + S_a x P) + (b - g) (a' - radius n'),    d' = (g S_a + (b - g) n x n') x d,
//   S_i' = S_j x S_i    if j belongs to the joint of i or to one below it,
//
// a' and n' by the body alone: of a point with its middle a over a plane a' = S_l + S_a x a and n' = 0, of shapes that
// meet as in `features.hpp`. Turning around n is left out: friction is the same along every tangent. Stops and dry
// friction have rows that stay. `condyn_pin/constraints/partials` has the same in Python.
#pragma once
#include "candidates.hpp"
#include "features.hpp"

namespace condyn
{
class ContactTurning
{
public:
  ContactTurning(const Model & model, const Candidates & candidates);

  /// The coordinates that move the body of a cone, or its ground.
  std::vector<int> columns(int cone) const;
  /// Goes to where data.oMi and data.J are, for some of the cones; false where a point has no derivative.
  bool go(const Data & data, const std::vector<int> & cones);
  /// J w by q of each cone, three rows each (3 k, nv), w fixed.
  void slips(const VectorXd & w, MatrixXd & by_q);
  /// Adds J^T lam by q (nv, nv), lam (3 k,) fixed.
  void pulls(const VectorXd & lam, Eigen::Ref<MatrixXd> by_q) const;

private:
  /// A coordinate that moves the body of a point, or its ground.
  struct Mover
  {
    int column;
    bool body, ground;
    double moves() const { return double(body) - double(ground); }
  };
  struct Rates
  {
    Vector3d P, axes; // the velocity of the point, and how fast its axes turn
  };
  struct Touching
  {
    int joint, ground;
    Matrix3d d; // t1, t2, n as rows
    Vector3d P, a;
    double radius;
    bool slides; // along the body, or its normal turns past the ground
    Sliding how;
    const std::vector<Mover> * movers;

    /// By a twist of the body alone.
    Rates by_body(const Vector3d & linear, const Vector3d & angular) const;
  };
  bool meet(int first, const Pair & pair, const Data & data, const std::vector<int> & cones);

  const Model & model_;
  const Candidates & candidates_;
  std::vector<std::vector<Mover>> movers_; // of each cone
  std::vector<int> joint_of_; // each coordinate
  std::vector<Touching> now_;
  Matrix6x S_;
  std::vector<Eigen::Matrix<double, 6, 1>> twists_; // of each joint, at the origin of the world
};
} // namespace condyn
