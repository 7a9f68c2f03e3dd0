#include "minimum_norm.hpp"
#include "springs.hpp"
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

MinimumNorm::MinimumNorm(const Scene & scene)
: scene_(scene), factor_(scene.model, ties(scene)), nothing_(VectorXd::Zero(scene.model.nv))
{}

bool MinimumNorm::factorise(const MatrixXd & M, const MatrixXd & J)
{
  if (!whiten(M, J, nothing_below))
    return false;
  if (J.rows() && !(!scene_.rank.dependent && is_clear(J, rank_tolerance))
      && !(of_columns_.last() > something_above * of_columns_.first()))
    return false;
  return divide();
}

bool MinimumNorm::factorise_independent(const MatrixXd & M, const MatrixXd & J)
{
  return whiten(M, J, nothing_below) && (!J.rows() || is_clear(J, something_above)) && divide();
}

bool MinimumNorm::factorise(const MatrixXd & M, const MatrixXd & J, int count)
{
  return whiten(M, J, 0.0, count) && rank() == count && divide();
}

bool MinimumNorm::whiten(const MatrixXd & M, const MatrixXd & J, double nothing, int most)
{
  lower_ = M.transpose();
  if (!factor_.factorise(lower_, nothing_) || (J.rows() && !(J.squaredNorm() > scene_.rank.least)))
    return false;
  rows_ = J;
  factor_.whiten_rows(rows_);
  of_columns_.compute(rows_.transpose(), nothing, most);
  return !J.rows() || rank();
}

/// Whether all rows are independent: no pivot is below a share of the largest, or rounding.
bool MinimumNorm::is_clear(const MatrixXd & J, double share) const
{
  const double largest = scene_.weights.maxCoeff(); // squared, the largest of M^-1: what J M^-1 J^T is rounded by
  const double rounding = std::numeric_limits<double>::epsilon() * largest * largest * J.squaredNorm();
  return rank() == J.rows()
    && of_columns_.last() > std::max(share * of_columns_.first(), std::sqrt(noise * rounding));
}

//   B = Q' R',    K R'^T = Q'
bool MinimumNorm::divide()
{
  const int m = int(rows_.rows());
  rows_ = of_columns_.Q().transpose();
  factor_.unwhiten_rows(rows_);
  U = rows_.transpose();
  MatrixXd & B = pushed_;
  B.resize(m, rank());
  for (int j = 0; j < m; ++j)
    B.row(of_columns_.order[j]) = of_columns_.R().col(j).transpose();
  of_rows_.compute(B, 0.0);
  if (of_rows_.rank < rank())
    return false;
  K.resize(m, rank());
  for (int k = rank() - 1; k >= 0; --k)
  {
    const int at = of_rows_.order[k];
    K.col(at) = of_rows_.Q().col(k);
    for (int j = k + 1; j < rank(); ++j)
      K.col(at) -= of_rows_.R()(k, j) * K.col(of_rows_.order[j]);
    K.col(at) /= of_rows_.R()(k, k);
  }
  return true;
}

VectorXd MinimumNorm::solve(VectorXd & r, const VectorXd & s) const
{
  factor_.whiten(r);
  VectorXd z = K.transpose() * s, lam(s.size());
  z.noalias() -= of_columns_.Q().transpose() * r;
  r.noalias() += of_columns_.Q() * z;
  lam.noalias() = K * z;
  factor_.unwhiten(r);
  return lam;
}

void MinimumNorm::invert(MatrixXd & inverse)
{
  const int n = factor_.size(), m = int(K.rows());
  factor_.invert(mobility_);
  inverse.resize(n + m, n + m);
  pushed_.resize(m, n);
  if (m)
  {
    mobility_.noalias() -= U * U.transpose();
    pushed_.noalias() = K * U.transpose();
    inverse.bottomRightCorner(m, m).noalias() = K * K.transpose();
  }
  inverse.topLeftCorner(n, n) = mobility_;
  inverse.topRightCorner(n, m) = pushed_.transpose();
  inverse.bottomLeftCorner(m, n) = -pushed_;
}
} // namespace condyn
