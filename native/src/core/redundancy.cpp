#include "redundancy.hpp"
#include <algorithm>
#include <cmath>

namespace condyn
{
namespace
{
const double times_the_move = 4.0; // as in Python, and so are these
const double of_a_move = 1.4;
const double small = 1e-8, turned_enough = 1e-10;
const int turns = 30;
} // namespace

void Redundancy::at(const MatrixXd & J, const VectorXd & c)
{
  const int m = int(J.rows());
  scaled_ = (plan_.R.asDiagonal() * J * plan_.D.asDiagonal()).transpose();
  rows_.compute(scaled_, 0.0);
  most_ = int(std::min(J.rows(), J.cols()));
  gaps_.resize(m);
  for (int i = 0; i < m; ++i)
    gaps_[i] = plan_.R[rows_.order[i]] * c[rows_.order[i]];
  const int usually = usual();
  rank = usually ? usually : counted();
  const VectorXd y = closing(rank);
  // what the kept rows leave open; where all are left out, all of the gap
  VectorXd open = gaps_.tail(m - rank);
  if (rank)
    open -= rows_.R().block(0, rank, rank, m - rank).transpose() * y;
  last_ = rank ? pivot(rank - 1) : 1.0;
  doubt = std::max(y.norm(), open.norm()) / last_;
  N.resize(m, m - rank);
  if (rank == m)
    return;
  const MatrixXd x = dependence();
  combinations_.setZero(m, m - rank);
  for (int i = 0; i < m; ++i)
  {
    const int row = rows_.order[i];
    if (i < rank)
      combinations_.row(row) = plan_.R[row] * x.row(i);
    else
      combinations_(row, i - rank) = plan_.R[row];
  }
  left_.compute(combinations_, 0.0);
  N = left_.Q();
}

/// The closing move dq turns what J a and J^T lam are by |dq| over the last pivot, and changes J v by |dq| |v|; what
/// stops that and `rate` changes gamma, and that a.
double Redundancy::changes(
  const VectorXd & v, const VectorXd & a, const VectorXd & pull, const VectorXd & rate, double gravity) const
{
  const double dv = plan_.R.cwiseProduct(rate).norm() / last_;
  const double moved = shared(doubt, v, a, pull.cwiseQuotient(plan_.D).norm(), dv, gravity);
  const double rounded = shared(plan_.least / (last_ * last_), v, a, 0.0, 0.0, gravity);
  return std::max({doubt, moved, rounded});
}

double Redundancy::shared(
  double moved, const VectorXd & v, const VectorXd & a, double pull, double dv, double gravity) const
{
  const double speed = v.cwiseQuotient(plan_.D).norm(), of_a = a.cwiseQuotient(plan_.D).norm();
  const double size = std::max(of_a, gravity / plan_.size);
  dv += of_a_move * moved * speed;
  const double change = of_a_move * (moved * (of_a + pull) + 2.0 * speed * dv / last_);
  return size > 0 ? change / size : change;
}

double Redundancy::rounding() const
{
  return std::max(plan_.share * pivot(0), plan_.least);
}

/// The rank at closed states, if no more rows count and so many are more than rounding; 0 if not.
int Redundancy::usual() const
{
  const int k = plan_.floor;
  if (!(0 < k && k < most_ && pivot(k - 1) > rounding()))
    return 0;
  if (pivot(k) <= rounding())
    return k;
  return pivot(k) <= times_the_move * closing(k).norm() ? k : 0;
}

int Redundancy::counted() const
{
  int alive = 0;
  while (pivot(alive) > rounding())
    ++alive;
  const VectorXd y = closing(alive);
  double squared = 0;
  for (int k = 0; k < alive; ++k)
  {
    squared += y[k] * y[k];
    if (!(pivot(k) > times_the_move * std::sqrt(squared)))
      return std::max(k, std::min(plan_.floor, alive));
  }
  return alive;
}

/// The move that closes k rows, along those of Q.
VectorXd Redundancy::closing(int k) const
{
  VectorXd y(k);
  for (int i = 0; i < k; ++i)
    y[i] = (gaps_[i] - rows_.R().col(i).head(i).dot(y.head(i))) / pivot(i);
  return y;
}

/// x (rank, m - rank) of the singular subspace [x; 1], by a fixed point:
///
///   T_11^T (T_11 x + T_12) = x H,    H = T_12^T (T_11 x + T_12) + T_22^T T_22 = (1 + x_0^T x)^-1 T_22^T T_22
MatrixXd Redundancy::dependence() const
{
  const int m = int(gaps_.size()), k = rank, others = m - k;
  if (!k)
    return MatrixXd(0, others);
  const MatrixXd T11 = rows_.R().topLeftCorner(k, k), T12 = rows_.R().block(0, k, k, others);
  const auto upper = T11.triangularView<Eigen::Upper>();
  const MatrixXd first = -upper.solve(T12);
  if (!(k < most_ && pivot(k) > small * pivot(k - 1)))
    return first;
  const auto T22 = rows_.R().block(k, k, rows_.rank - k, others);
  const MatrixXd H22 = T22.transpose() * T22, one = MatrixXd::Identity(others, others);
  MatrixXd x = first;
  double off = INFINITY;
  for (int turn = 0; turn < turns; ++turn)
  {
    const MatrixXd H = (one + first.transpose() * x).partialPivLu().solve(H22);
    const MatrixXd u = T11.transpose().triangularView<Eigen::Lower>().solve(x * H); // T_11 (x - x_0)
    const MatrixXd better = first + upper.solve(u);
    const double change = (better - x).cwiseAbs().maxCoeff();
    if (!(change < off)) // values too close to tell subspaces apart
      break;
    x = better, off = change;
    if (change < turned_enough)
      break;
  }
  return x;
}
} // namespace condyn
