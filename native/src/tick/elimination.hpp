// Elimination: accelerations that keep the rows that are held, and torques that the motors then give.
//
//   J_l a = r,  J_l^T P = Q_1 R:    a = a_0 + N z,    a_0 = Q_1 R^-T P^T r,    N = Q_2
//   S = N^T E:    t = S^+ N^T f + Y w,    X^T N^T f = 0
//
// with Y and X the null spaces of S and of S^T. `condyn_pin/control/program.py` says more.
#pragma once
#include "scene.hpp"
#include <Eigen/Dense>

namespace condyn
{
class Elimination
{
public:
  /// False where a rank is in doubt, or no motor reaches anything. `motors` are entries of v; `rank` is relative to the
  /// largest pivot of J, and what is left of unit vectors.
  bool at(const MatrixXd & J, const std::vector<int> & motors, double rank);

  /// a_0, the smallest acceleration with J a = r.
  VectorXd particular(const VectorXd & r) const;
  /// lam with J^T lam = f, the smallest if many.
  VectorXd forces(const VectorXd & f) const;

  MatrixXd N, drive, unreached, inner; // unreached: X^T, inner: Y

private:
  int rank_ = 0;
  Eigen::ColPivHouseholderQR<MatrixXd> rows_;
  Eigen::CompleteOrthogonalDecomposition<MatrixXd> motors_;
  MatrixXd Q_, S_;
};

/// What is nearest to r of all J z, and the rank of J.
int nearest_reached(const MatrixXd & J, VectorXd & r, double rank);
} // namespace condyn
