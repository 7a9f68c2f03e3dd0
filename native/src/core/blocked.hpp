// What constraints block: the row space of J_b in the metric of M, by a complete orthogonal decomposition.
//
//   M = S^T S,    S^-T J_b^T P = Q [T 0; 0 0] Z,    V = the first columns of Q
//
// J_b^T has the pseudo-inverse of its singular values, without their decomposition, where its rank is clear.
#pragma once
#include "pinocchio.hpp"
#include <Eigen/Dense>

namespace condyn
{
class Blocked
{
  Eigen::CompleteOrthogonalDecomposition<MatrixXd> factor_;
  MatrixXd T_, Z_;
  int rows_ = 0;

public:
  int rank = 0;
  MatrixXd V; // (nv, rank), orthonormal

  /// Of S^-T J_b^T (nv, rows); `tolerance` of its pivots relative to the largest.
  void compute(const MatrixXd & whitened, double tolerance)
  {
    rows_ = int(whitened.cols());
    rank = 0;
    if (!rows_)
      return;
    factor_.setThreshold(tolerance);
    factor_.compute(whitened);
    rank = int(factor_.rank());
    T_ = factor_.matrixT().topLeftCorner(rank, rank);
    // without a redundant row Eigen leaves the coefficients of Z unset, and multiplies by them all the same
    if (rank < rows_)
      Z_ = factor_.matrixZ();
    else
      Z_ = MatrixXd::Identity(rows_, rows_);
    V = factor_.householderQ().setLength(rank) * MatrixXd::Identity(whitened.rows(), rank);
  }

  /// h with V h the least velocity S v for which J_b v = s; of one s (rows,) or of columns of them.
  template<typename Columns>
  typename Columns::PlainObject held(const Eigen::MatrixBase<Columns> & s) const
  {
    const typename Columns::PlainObject turned = Z_ * (factor_.colsPermutation().transpose() * s);
    return T_.transpose().triangularView<Eigen::Lower>().solve(turned.topRows(rank));
  }

  /// The smallest l with S^-T J_b^T l = V h.
  VectorXd impulses(const VectorXd & h) const
  {
    VectorXd l = VectorXd::Zero(rows_);
    if (rank)
      l.head(rank) = T_.triangularView<Eigen::Upper>().solve(h);
    return rank ? VectorXd(factor_.colsPermutation() * (Z_.transpose() * l)) : l;
  }
};
} // namespace condyn
