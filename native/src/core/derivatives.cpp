#include "derivatives.hpp"
#include <cmath>

namespace condyn
{
Derivatives::Derivatives(const Scene & scene)
: scene_(scene), linearisation_(scene), carried_(linearisation_.touched()), factors_(scene)
{}

bool Derivatives::operator()(
  const VectorXd & q, const VectorXd & v, const VectorXd & a, const VectorXd & lam, const Loads & loads,
  const Data & placed, double * const out[6])
{
  const int n = scene_.model.nv, m = scene_.rows;
  linearisation_.at(q, v, a, lam, loads, placed);
  if (!factors_.factorise(linearisation_.data.M, linearisation_.J))
    return false;
  factors_.invert(inverse_);
  by_state_.setZero(n + m, 2 * n);
  carried_.add_product(inverse_, linearisation_.asked, by_state_);
  if (factors_.dependent())
    by_state_.bottomLeftCorner(m, n) += along_redundant_rows(lam);
  write(out);
  return std::isfinite(by_state_.sum() + inverse_.sum()); // a sum that overflows is looked at as well
}

void Derivatives::write(double * const out[6]) const
{
  const int n = scene_.model.nv, m = scene_.rows;
  for (int k = 0; k < 3; ++k)
  {
    const auto by = k < 2 ? by_state_.middleCols(k * n, n) : inverse_.leftCols(n);
    Eigen::Map<RowMajor>(out[k], n, n) = by.topRows(n);
    if (m)
      Eigen::Map<RowMajor>(out[3 + k], m, n) = by.bottomRows(m);
  }
}

/// What keeps lam the smallest as the rows turn.
MatrixXd Derivatives::along_redundant_rows(const VectorXd & lam)
{
  const VectorXd w = factors_.U * (factors_.K.transpose() * lam); // lam = J w, the smallest in the metric of M
  const MatrixXd turned = linearisation_.turning(w);
  return turned - factors_.forces() * (factors_.forces().transpose() * turned);
}
} // namespace condyn
