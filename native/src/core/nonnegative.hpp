// Nonnegative least squares: min |A x - b| with x >= 0, by Lawson and Hanson's active sets.
//
// Lawson, Hanson. Solving Least Squares Problems. SIAM 1995, chapter 23.
#pragma once
#include <Eigen/Dense>
#include <algorithm>
#include <limits>
#include <vector>

namespace condyn
{
/// Fills x; false where more rounds are needed than three for each column.
inline bool nonnegative_least_squares(const Eigen::MatrixXd & A, const Eigen::VectorXd & b, Eigen::VectorXd & x)
{
  constexpr double eps = std::numeric_limits<double>::epsilon();
  const Eigen::Index n = A.cols();
  const double small = 10 * eps * double(std::max(A.rows(), n)) * A.cwiseAbs().colwise().sum().maxCoeff();
  x.setZero(n);
  std::vector<Eigen::Index> free; // columns with x > 0
  std::vector<char> is_free(n, 0);
  for (Eigen::Index round = 0; round < 3 * n;)
  {
    const Eigen::VectorXd w = A.transpose() * (b - A * x);
    Eigen::Index best = -1;
    for (Eigen::Index j = 0; j < n; ++j)
      if (!is_free[j] && w[j] > small && (best < 0 || w[j] > w[best]))
        best = j;
    if (best < 0)
      return true;
    free.push_back(best), is_free[best] = 1;
    for (;; ++round)
    {
      if (round >= 3 * n)
        return false;
      const Eigen::VectorXd s = A(Eigen::all, free).colPivHouseholderQr().solve(b);
      double share = 1.0;
      for (std::size_t k = 0; k < free.size(); ++k)
        if (s[k] <= 0.0)
          share = std::min(share, x[free[k]] / (x[free[k]] - s[k]));
      for (std::size_t k = 0; k < free.size(); ++k)
        x[free[k]] += share * (s[k] - x[free[k]]);
      if (share == 1.0)
        break;
      std::vector<Eigen::Index> kept;
      for (Eigen::Index j : free)
        if (x[j] > eps)
          kept.push_back(j);
        else
          x[j] = 0.0, is_free[j] = 0;
      if (kept.size() == free.size()) // rounding: nothing has left
        return false;
      free = kept;
    }
    ++round;
  }
  return false;
}
} // namespace condyn
