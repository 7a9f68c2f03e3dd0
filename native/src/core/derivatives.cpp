#include "derivatives.hpp"

namespace condyn
{
Derivatives::Derivatives(const Scene & scene)
: scene_(scene), linearisation_(scene), factors_(scene)
{}

bool Derivatives::operator()(
  const VectorXd & q, const VectorXd & v, const VectorXd & a, const VectorXd & lam, const Loads & loads,
  const Data & placed, double * const out[6])
{
  const int n = scene_.model.nv, m = scene_.rows;
  linearisation_.at(q, v, a, lam, loads, placed);
  if (!factors_.factorise(linearisation_.data.M, linearisation_.J))
    return false;
  MatrixXd da(n, 3 * n);
  da << linearisation_.r, MatrixXd::Identity(n, n);
  MatrixXd dlam = factors_.solve(da, linearisation_.s);
  if (factors_.dependent())
    dlam.leftCols(n) += along_redundant_rows(q, lam);
  for (int k = 0; k < 3; ++k)
  {
    Eigen::Map<RowMajor>(out[k], n, n) = da.middleCols(k * n, n);
    if (m)
      Eigen::Map<RowMajor>(out[3 + k], m, n) = dlam.middleCols(k * n, n);
  }
  return da.allFinite() && dlam.allFinite();
}

/// What keeps lam the smallest as the rows turn.
MatrixXd Derivatives::along_redundant_rows(const VectorXd & q, const VectorXd & lam)
{
  // lam = J w, with the smallest w in the metric of M
  VectorXd w = factors_.Q * (factors_.B_inverse * lam);
  factors_.L.triangularView<Eigen::Lower>().transpose().solveInPlace(w);
  const MatrixXd turned = linearisation_.turning(q, w);
  return turned - factors_.Q2 * (factors_.Q2.transpose() * turned);
}
} // namespace condyn
