// How the rows of contact points over planes change with q.
//
// A point with its middle p touches at P = p - radius n, and has the rows d . (S_l + S_a x P) of each column
// S = (S_l, S_a) that moves body or ground, in the axes of the world and at its origin. A step of coordinate j
// carries along what is above it,
//
//   P'   = b_j (S_l + S_a x p)_j - g_j radius S_aj x n,    d' = g_j S_aj x d,
//   S_i' = S_j x S_i    if j belongs to the joint of i or to one below it,
//
// with b_j and g_j one where j moves the body and the ground. Stops and dry friction have rows that stay.
// `condyn_pin/constraints/partials/contacts.py` has the same in Python.
#pragma once
#include "candidates.hpp"

namespace condyn
{
class ContactTurning
{
public:
  ContactTurning(const Model & model, const Candidates & candidates);

  /// The coordinates that move the body of a point, or its ground.
  std::vector<int> columns(int point) const;
  /// Goes to where data.oMi and data.J are, for some of the points.
  void go(const Data & data, const std::vector<int> & points);
  /// J w by q of each point, three rows each (3 k, nv), w fixed.
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
  struct Touching
  {
    int joint, ground;
    Matrix3d d; // t1, t2, n as rows
    Vector3d P, p, radial; // p - P
    const std::vector<Mover> * movers;
  };

  const Model & model_;
  const Candidates & candidates_;
  std::vector<std::vector<Mover>> movers_; // of each point
  std::vector<int> joint_of_; // each coordinate
  std::vector<Touching> now_;
  Matrix6x S_;
  std::vector<Eigen::Matrix<double, 6, 1>> twists_; // of each joint, at the origin of the world
};
} // namespace condyn
