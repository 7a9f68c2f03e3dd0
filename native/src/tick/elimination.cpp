#include "elimination.hpp"

namespace condyn
{
namespace
{
/// Whether pivots, largest first, are clearly more than `least`, or clearly less.
template<typename Pivots>
bool is_clear(const Pivots & pivots, double least)
{
  const double margin = 1e2; // beyond it rounding decides nothing, also by another factorisation
  for (Eigen::Index i = 0; i < pivots.size(); ++i)
    if (!(std::abs(pivots[i]) > margin * least || std::abs(pivots[i]) < least / margin))
      return false;
  return true;
}
} // namespace

bool Elimination::at(const MatrixXd & J, const std::vector<int> & motors, double rank)
{
  rows_.setThreshold(rank);
  rows_.compute(J.transpose());
  if (!is_clear(rows_.matrixQR().diagonal(), rank * rows_.maxPivot()))
    return false;
  rank_ = int(rows_.rank());
  const Eigen::Index n = J.cols(), k = n - rank_;
  if (k == 0 || rank_ == 0)
    return false;
  Q_ = rows_.householderQ() * MatrixXd::Identity(n, n);
  N = Q_.rightCols(k);
  S_.resize(k, motors.size());
  for (std::size_t i = 0; i < motors.size(); ++i)
    S_.col(i) = N.row(motors[i]).transpose();
  const double longest = S_.colwise().norm().maxCoeff();
  if (!(longest > rank)) // entries of N are those of unit vectors: motors that are held reach nothing
    return false;
  motors_.setThreshold(rank / longest);
  motors_.compute(S_);
  if (!is_clear(motors_.matrixQTZ().diagonal(), rank))
    return false;
  const Eigen::Index reached = motors_.rank();
  drive = motors_.pseudoInverse();
  const MatrixXd Q = motors_.householderQ() * MatrixXd::Identity(k, k);
  unreached = Q.rightCols(k - reached).transpose();
  inner = (motors_.colsPermutation() * motors_.matrixZ().transpose()).rightCols(S_.cols() - reached);
  return true;
}

VectorXd Elimination::particular(const VectorXd & r) const
{
  const VectorXd chosen = (rows_.colsPermutation().transpose() * r).head(rank_);
  const auto R = rows_.matrixQR().topLeftCorner(rank_, rank_).triangularView<Eigen::Upper>();
  return Q_.leftCols(rank_) * R.transpose().solve(chosen);
}

VectorXd Elimination::forces(const VectorXd & f) const
{
  const Eigen::Index m = rows_.matrixQR().cols();
  const auto R = rows_.matrixQR().topLeftCorner(rank_, rank_).triangularView<Eigen::Upper>();
  VectorXd y = R.solve(Q_.leftCols(rank_).transpose() * f), lam = VectorXd::Zero(m);
  if (m > rank_) // redundant rows: J^T P = Q_1 (R, R'), W = R^-1 R', (1 + W W^T) y = R^-1 Q_1^T f
  {
    const MatrixXd W = R.solve(rows_.matrixQR().topRightCorner(rank_, m - rank_));
    y = (MatrixXd::Identity(rank_, rank_) + W * W.transpose()).llt().solve(y);
    lam.tail(m - rank_) = W.transpose() * y;
  }
  lam.head(rank_) = y;
  return rows_.colsPermutation() * lam;
}

int nearest_reached(const MatrixXd & J, VectorXd & r, double rank)
{
  Eigen::ColPivHouseholderQR<MatrixXd> factor(J.rows(), J.cols());
  factor.setThreshold(rank);
  factor.compute(J);
  const int found = int(factor.rank());
  if (found < J.rows())
  {
    VectorXd along = factor.householderQ().transpose() * r;
    along.tail(along.size() - found).setZero();
    r = factor.householderQ() * along;
  }
  return found;
}
} // namespace condyn
