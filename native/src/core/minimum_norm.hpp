// Gauss's principle in the metric of M, as `MinimumNorm` in Python:
//
//   M a - J^T lam = r,    J a = s
//
//   M = L L^T,    J L^-T = B Q^T,    y = L^-1 r,    z = B^+ s - Q^T y
//   L^T a = y + Q z,    lam = B^+T z
//
// with Q of orthonormal columns and B of full rank: R^T of L^-1 J^T = Q R where rows are independent, and
// with pivots on the columns where they are not. There lam is the smallest.
#pragma once
#include "scene.hpp"

namespace condyn
{
/// The factors of one M and J.
class MinimumNorm
{
public:
  explicit MinimumNorm(const Scene & scene) : scene_(scene) {}

  /// Of M in its upper triangle; false where M is not positive definite, or the rank is in doubt.
  bool factorise(const MatrixXd & M, const MatrixXd & J);
  /// The same, and false where rows are not clearly independent.
  bool factorise_independent(const MatrixXd & M, const MatrixXd & J);

  /// Returns lam, and a in the place of r. Where s has fewer columns than r, the others are zero.
  MatrixXd solve(Eigen::Ref<MatrixXd> r, const Eigen::Ref<const MatrixXd> & s) const;

  bool dependent() const { return Q2.size() > 0; }

  MatrixXd L, Q, B_inverse; // B^+ (rank, m)
  MatrixXd Q2; // orthonormal columns that span those of B; empty where rows are independent

private:
  bool whiten(const MatrixXd & M, const MatrixXd & J);
  bool by_rows(const MatrixXd & J, double share);
  bool by_pivots();

  const Scene & scene_;
  MatrixXd A_; // L^-1 J^T
};
} // namespace condyn
