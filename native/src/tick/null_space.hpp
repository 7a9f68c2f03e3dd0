// What rows take to zero: an orthonormal basis of it, and how many of the rows are independent.
//
// By a pivoted QR of the rows as columns, A P = Q R, where no singular value is near what counts, and otherwise by the
// singular values themselves, A = U S V^T: Q_2, or U_2, is orthogonal to all of them.
#pragma once
#include <Eigen/Dense>

namespace condyn
{
using Eigen::MatrixXd;
using Eigen::VectorXd;

class NullSpace
{
public:
  /// Takes rows as columns (n, m), of which singular values count that are more than a share of the largest. False where
  /// one is within two decades of that, or another basis would be as good.
  bool by_pivots(const MatrixXd & columns, double share);
  /// The same by the singular values, false where one is that share itself but for a factor.
  bool by_singular_values(const MatrixXd & columns, double share, double factor);

  Eigen::Index rank() const { return rank_; }
  /// Orthonormal columns (n, n - rank).
  const MatrixXd & basis() const { return basis_; }
  /// The smallest x with A^T x = b, of the last columns that were taken.
  VectorXd least(const VectorXd & b) const;

private:
  Eigen::ColPivHouseholderQR<MatrixXd> factor_;
  Eigen::JacobiSVD<MatrixXd> values_;
  MatrixXd basis_;
  Eigen::Index rank_ = 0;
  enum { nothing, pivots, singular_values } by_ = nothing;
};
} // namespace condyn
