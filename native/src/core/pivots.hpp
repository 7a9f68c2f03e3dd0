// The diagonal of R of a pivoted Cholesky factorisation P^T A P = R^T R, as LAPACK's dpstrf has it.
#pragma once
#include "pinocchio.hpp"
#include <cmath>
#include <limits>

namespace condyn
{
/// Factorises A in its upper triangle, in place; returns the rank, the last one at which a pivot was
/// more than rounding, n eps max_i A_ii.
inline int pivoted_cholesky(MatrixXd & A)
{
  const int n = int(A.rows());
  VectorXd work = VectorXd::Zero(n);
  double stop = 0;
  for (int j = 0; j < n; ++j)
  {
    int pivot = j;
    double largest = -std::numeric_limits<double>::infinity();
    for (int i = j; i < n; ++i)
    {
      if (j > 0)
        work[i] += A(j - 1, i) * A(j - 1, i);
      const double left = A(i, i) - work[i];
      if (std::isnan(left))
        return j;
      if (left > largest)
        largest = left, pivot = i;
    }
    if (j == 0)
      stop = n * std::ldexp(1.0, -53) * largest;
    if (!(largest > stop))
      return j;
    if (pivot != j)
    {
      A(pivot, pivot) = A(j, j);
      A.col(j).head(j).swap(A.col(pivot).head(j));
      for (int i = pivot + 1; i < n; ++i)
        std::swap(A(j, i), A(pivot, i));
      for (int i = j + 1; i < pivot; ++i)
        std::swap(A(j, i), A(i, pivot));
      std::swap(work[j], work[pivot]);
    }
    const double root = std::sqrt(largest);
    A(j, j) = root;
    for (int i = j + 1; i < n; ++i)
    {
      A(j, i) -= A.col(j).head(j).dot(A.col(i).head(j));
      A(j, i) /= root;
    }
  }
  return n;
}
} // namespace condyn
