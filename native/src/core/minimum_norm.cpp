#include "minimum_norm.hpp"
#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <cmath>
#include <limits>

namespace condyn
{
namespace
{
const double rank_tolerance = 1e-7, noise = 1e3; // as in Python: RANK and _NOISE

// Pivots between these, relative to the first, are neither rounding nor clearly more: Python looks.
const double nothing_below = 1e-9, something_above = 1e-5;
} // namespace

bool MinimumNorm::factorise(const MatrixXd & M, const MatrixXd & J)
{
  if (!whiten(M, J))
    return false;
  return J.rows() == 0 || (!scene_.rank.dependent && by_rows(J, rank_tolerance)) || by_pivots();
}

bool MinimumNorm::factorise_independent(const MatrixXd & M, const MatrixXd & J)
{
  return whiten(M, J) && (J.rows() == 0 || by_rows(J, something_above));
}

bool MinimumNorm::whiten(const MatrixXd & M, const MatrixXd & J)
{
  const Eigen::LLT<MatrixXd, Eigen::Upper> llt(M);
  if (llt.info() != Eigen::Success || (J.rows() && !(J.squaredNorm() > scene_.rank.least)))
    return false;
  L = llt.matrixL();
  A_ = J.transpose();
  L.triangularView<Eigen::Lower>().solveInPlace(A_);
  Q2.resize(0, 0);
  return true;
}

/// By L^-1 J^T = Q R; false where a pivot of R is below a share of the largest, or rounding.
bool MinimumNorm::by_rows(const MatrixXd & J, double share)
{
  const int n = int(A_.rows()), m = int(A_.cols());
  if (m > n)
    return false;
  const Eigen::HouseholderQR<MatrixXd> qr(A_);
  const VectorXd pivots = qr.matrixQR().diagonal().cwiseAbs();
  const double largest = scene_.weights.maxCoeff(); // squared, the largest of M^-1: what J M^-1 J^T is rounded by
  const double rounding = std::numeric_limits<double>::epsilon() * largest * largest * J.squaredNorm();
  const double least = std::max(share * pivots.maxCoeff(), std::sqrt(noise * rounding));
  if (!(pivots.minCoeff() > least))
    return false;
  Q = qr.householderQ() * MatrixXd::Identity(n, m);
  B_inverse = qr.matrixQR().topRows(m).triangularView<Eigen::Upper>().transpose().solve(MatrixXd::Identity(m, m));
  return true;
}

/// With pivots on the columns.
bool MinimumNorm::by_pivots()
{
  const int n = int(A_.rows()), m = int(A_.cols());
  const Eigen::ColPivHouseholderQR<MatrixXd> qr(A_);
  const VectorXd pivots = qr.matrixR().diagonal().cwiseAbs();
  int rank = 0;
  for (double pivot : pivots)
    if (pivot > something_above * pivots[0])
      ++rank;
    else if (!(pivot < nothing_below * pivots[0]))
      return false;
  Q = qr.householderQ() * MatrixXd::Identity(n, rank);
  const MatrixXd R = qr.matrixR().topRows(rank).triangularView<Eigen::Upper>();
  const MatrixXd B = qr.colsPermutation() * R.transpose(); // of full column rank: Q2 R2
  const Eigen::HouseholderQR<MatrixXd> of_rows(B);
  Q2 = of_rows.householderQ() * MatrixXd::Identity(m, rank);
  B_inverse = of_rows.matrixQR().topRows(rank).triangularView<Eigen::Upper>().solve(MatrixXd(Q2.transpose()));
  return true;
}

MatrixXd MinimumNorm::solve(Eigen::Ref<MatrixXd> r, const Eigen::Ref<const MatrixXd> & s) const
{
  L.triangularView<Eigen::Lower>().solveInPlace(r); // y
  MatrixXd lam(s.rows(), r.cols());
  if (s.rows())
  {
    MatrixXd z(Q.cols(), r.cols());
    z.noalias() = -Q.transpose() * r;
    z.leftCols(s.cols()).noalias() += B_inverse * s;
    r.noalias() += Q * z;
    lam.noalias() = B_inverse.transpose() * z;
  }
  L.triangularView<Eigen::Lower>().transpose().solveInPlace(r);
  return lam;
}
} // namespace condyn
