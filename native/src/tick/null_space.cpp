#include "null_space.hpp"

namespace condyn
{
namespace
{
constexpr double margin = 1e2; // of what is left, which turns a basis by rounding over it: 1e-16 over 1e-5
constexpr double rounding = 1e-12; // relative: a larger rest turns the basis by which factorisation finds it
} // namespace

// With A P = Q (R_11, R_12; 0, R_22), the smallest singular value that counts is no less than 1 / |R_11^-1|, the largest
// that does not count no more than |R_22|, in the norm of Frobenius. The largest of all is no less than the first pivot.
bool NullSpace::by_pivots(const MatrixXd & columns, double share)
{
  const Eigen::Index n = columns.rows(), most = std::min(n, columns.cols());
  rank_ = 0, by_ = nothing;
  if (!columns.allFinite())
    return false;
  basis_.setIdentity(n, n);
  if (!most || columns.isZero(0.0))
    return true;
  by_ = pivots;
  factor_.compute(columns);
  const MatrixXd & R = factor_.matrixQR();
  const double first = std::abs(R(0, 0));
  while (rank_ < most && std::abs(R(rank_, rank_)) > share * first)
    ++rank_;
  const auto block = R.block(rank_, rank_, most - rank_, R.cols() - rank_);
  const MatrixXd rest = block.triangularView<Eigen::Upper>();
  const auto R_11 = R.topLeftCorner(rank_, rank_).triangularView<Eigen::Upper>();
  const MatrixXd inverse = R_11.solve(MatrixXd::Identity(rank_, rank_));
  basis_ = basis_.rightCols(n - rank_).eval();
  basis_.applyOnTheLeft(factor_.householderQ());
  return rest.norm() <= rounding * first && inverse.norm() * margin * share * first <= 1;
}

bool NullSpace::by_singular_values(const MatrixXd & columns, double share, double factor)
{
  rank_ = 0, by_ = nothing;
  if (!columns.size() || !columns.allFinite())
    return false;
  by_ = singular_values;
  values_.compute(columns, Eigen::ComputeFullU | Eigen::ComputeThinV);
  const VectorXd sizes = values_.singularValues() / values_.singularValues()[0];
  for (Eigen::Index i = 0; i < sizes.size(); ++i)
  {
    if (!(sizes[i] > factor * share || sizes[i] < share / factor))
      return false;
    rank_ += sizes[i] > share;
  }
  basis_ = values_.matrixU().rightCols(columns.rows() - rank_);
  return true;
}

VectorXd NullSpace::least(const VectorXd & b) const
{
  VectorXd x = VectorXd::Zero(basis_.rows());
  if (by_ == singular_values)
  {
    const VectorXd along = values_.matrixV().leftCols(rank_).transpose() * b;
    x = values_.matrixU().leftCols(rank_) * along.cwiseQuotient(values_.singularValues().head(rank_));
  }
  else if (by_ == pivots)
  {
    const VectorXd chosen = (factor_.colsPermutation().transpose() * b).head(rank_);
    const auto R_11 = factor_.matrixQR().topLeftCorner(rank_, rank_).triangularView<Eigen::Upper>();
    x.head(rank_) = R_11.transpose().solve(chosen);
    x.applyOnTheLeft(factor_.householderQ());
  }
  return x;
}
} // namespace condyn
