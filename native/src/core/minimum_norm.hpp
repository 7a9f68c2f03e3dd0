// Gauss's principle in the metric of M, as `MinimumNorm` in Python:
//
//   M a - J^T lam = r,    J a = s
//
//   M = S^T S,    S^-T J^T = Q B^T,    U = S^-1 Q,    K = B (B^T B)^-1
//
//   [ a   ]   [ M^-1 - U U^T   U K^T ] [ r ]
//   [ lam ] = [   -K U^T       K K^T ] [ s ]
//
// with Q of orthonormal columns and B of full rank: columns of U are motions that are held, and those of K the
// smallest forces that push against one of them each. Where rows are redundant, lam is the smallest.
#pragma once
#include "orthonormal.hpp"
#include "scene.hpp"
#include "tree_factor.hpp"

namespace condyn
{
/// The factors of one M and J.
class MinimumNorm
{
public:
  explicit MinimumNorm(const Scene & scene);

  /// Of M in its upper triangle; false where M is not positive definite, or the rank is in doubt.
  bool factorise(const MatrixXd & M, const MatrixXd & J);
  /// The same of rows so many of which are independent.
  bool factorise(const MatrixXd & M, const MatrixXd & J, int rank);
  /// The same, and false where rows are not clearly independent.
  bool factorise_independent(const MatrixXd & M, const MatrixXd & J);

  /// Returns lam, and a in the place of r.
  VectorXd solve(VectorXd & r, const VectorXd & s) const;
  /// The matrix above (nv + m, nv + m).
  void invert(MatrixXd & inverse);

  int rank() const { return of_columns_.rank; }
  bool dependent() const { return rank() < K.rows(); }
  /// Orthonormal columns that span those of B.
  auto forces() const { return of_rows_.Q(); }

  MatrixXd U, K; // (nv, rank), (m, rank)

private:
  bool whiten(const MatrixXd & M, const MatrixXd & J, double nothing, int most = std::numeric_limits<int>::max());
  bool is_clear(const MatrixXd & J, double share) const;
  bool divide();

  const Scene & scene_;
  TreeFactor factor_;
  const VectorXd nothing_; // on the diagonal
  MatrixXd lower_, rows_, mobility_, pushed_;
  Orthonormal of_columns_, of_rows_; // Q R of S^-T J^T, and of B
};
} // namespace condyn
