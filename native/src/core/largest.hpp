// The largest size of an entry.
#pragma once
#include <Eigen/Core>
#include <cmath>

namespace condyn
{
/// NaN where there is one, which Eigen's maximum may miss.
template<typename V>
double largest(const Eigen::MatrixBase<V> & x)
{
  double found = 0;
  for (Eigen::Index i = 0; i < x.size() && !std::isnan(found); ++i)
    if (!(std::abs(x.coeff(i)) <= found))
      found = std::abs(x.coeff(i));
  return found;
}
} // namespace condyn
