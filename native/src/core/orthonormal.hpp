// A P = Q R: orthonormal columns that span those of a matrix, the longest of what is left at each turn.
//
// Gram and Schmidt's, twice: a column is taken off all that come behind it, and before it is one of Q what rounding
// has left in it of those before is taken off once more (Golub, Van Loan, Matrix Computations, section 5.2).
#pragma once
#include "pinocchio.hpp"
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace condyn
{
class Orthonormal
{
public:
  /// Of columns, until all that is left of them is below a share of the longest, or so many are taken.
  void compute(const MatrixXd & columns, double nothing, int most = std::numeric_limits<int>::max())
  {
    const int m = int(columns.cols());
    A_ = columns, R_.setZero(m, m), left_ = A_.colwise().squaredNorm().transpose();
    order.resize(m);
    for (int j = 0; j < m; ++j)
      order[j] = j;
    for (rank = 0; rank < std::min({m, int(A_.rows()), most}); ++rank)
    {
      int longest;
      left_.tail(m - rank).maxCoeff(&longest);
      const double pivot = std::sqrt(left_[rank + longest]);
      if (!(pivot > 0 && (rank == 0 || pivot >= nothing * R_(0, 0))))
        return;
      to_the_front(rank + longest);
      take_off();
    }
  }

  auto Q() const { return A_.leftCols(rank); }
  /// (rank, m): of the columns in their order.
  auto R() const { return R_.topRows(rank); }
  double first() const { return R_(0, 0); }
  double last() const { return R_(rank - 1, rank - 1); }

  int rank = 0;
  std::vector<int> order; // P: which column each was

private:
  void to_the_front(int j)
  {
    if (j == rank)
      return;
    A_.col(j).swap(A_.col(rank));
    R_.col(j).head(rank).swap(R_.col(rank).head(rank));
    std::swap(left_[j], left_[rank]), std::swap(order[j], order[rank]);
  }

  void take_off()
  {
    auto q = A_.col(rank);
    for (int i = 0; i < rank; ++i)
    {
      const double again = A_.col(i).dot(q);
      q -= again * A_.col(i), R_(i, rank) += again;
    }
    R_(rank, rank) = q.norm();
    q /= R_(rank, rank);
    for (int j = rank + 1; j < A_.cols(); ++j)
    {
      R_(rank, j) = q.dot(A_.col(j));
      A_.col(j) -= R_(rank, j) * q;
      left_[j] = A_.col(j).squaredNorm();
    }
  }

  MatrixXd A_, R_;
  VectorXd left_; // squares of what is left of each
};
} // namespace condyn
