#include "active_set.hpp"
#include <cmath>

namespace condyn
{
namespace
{
constexpr double settled = 1e-14; // of the largest number: what is left is rounding
constexpr double aim = 1e-12; // [m/s^2]: violations below this are rounding
constexpr int repetitions = 10, rounds = 10;
} // namespace

double ActiveSet::solve(const QuadraticProgram & program, std::vector<Side> & sides, double enough)
{
  program_ = &program, sides_ = &sides, changes = 0;
  x.setZero(program.g.size()), z.setZero(program.lower.size());
  if (!factorise())
    return none;
  for (int round = 0; round < rounds; ++round)
  {
    gather();
    const double residual = refine();
    if (!std::isfinite(residual))
      break;
    if (change()) // a small residual does not end it: it says little of what the regularisation alone decides
      ++changes;
    else if (residual <= enough)
      return residual;
    else
      break;
  }
  return dual() ? refine() : none;
}

bool ActiveSet::factorise()
{
  const auto n = program_->g.size(), split = program_->split, rest = n - split;
  first_.compute(program_->H.topLeftCorner(split, split));
  others_.compute(program_->H.bottomRightCorner(rest, rest));
  if (first_.info() != Eigen::Success || others_.info() != Eigen::Success)
    return false;
  Q_.resize(n, n), R_.setZero(n, n), G_.resize(n, n), bound_.resize(n), multipliers_.setZero(n);
  count_ = 0;
  MatrixXd columns = program_->A;
  forward(columns);
  for (Eigen::Index i = 0; i < columns.cols(); ++i)
    append(columns.col(i), program_->A.col(i), program_->b[i]);
  equations_ = count_;
  return true;
}

void ActiveSet::take_out(VectorXd & column, VectorXd & shares) const
{
  const auto Q = Q_.leftCols(count_);
  const double whole = column.norm();
  shares = Q.transpose() * column;
  column -= Q * shares;
  if (column.norm() > 0.5 * whole) // little was lost to rounding
    return;
  const VectorXd again = Q.transpose() * column; // twice is enough
  column -= Q * again;
  shares += again;
}

bool ActiveSet::activate(int row, Side side, const VectorXd & column)
{
  const double bound = side == at_upper ? program_->upper[row] : program_->lower[row];
  if (!append(column, program_->C.col(row), bound))
    return false;
  active_.push_back(row);
  multipliers_[count_ - 1] = z[row];
  return true;
}

bool ActiveSet::append(VectorXd column, const Eigen::Ref<const VectorXd> & row, double bound)
{
  const double whole = column.norm();
  VectorXd shares;
  take_out(column, shares);
  const double left = column.norm();
  if (!(left > dependent * whole) || count_ == Q_.cols())
    return false;
  Q_.col(count_) = column / left;
  R_.col(count_).head(count_) = shares, R_(count_, count_) = left;
  G_.col(count_) = row, bound_[count_] = bound;
  ++count_;
  return true;
}

void ActiveSet::gather()
{
  count_ = equations_;
  active_.clear();
  for (int i = 0; i < int(sides_->size()); ++i)
  {
    const Side side = (*sides_)[i];
    if (side == between)
      continue;
    VectorXd column = program_->C.col(i);
    forward(column);
    activate(i, side, column);
  }
}

double ActiveSet::refine()
{
  const auto G = G_.leftCols(count_), Q = Q_.leftCols(count_);
  const auto R = R_.topLeftCorner(count_, count_).triangularView<Eigen::Upper>();
  auto y = multipliers_.head(count_);
  const auto bound = bound_.head(count_);
  const double size = 1.0 + largest(program_->g), reach = 1.0 + largest(bound);
  double before = none;
  for (int repetition = 0; repetition < repetitions; ++repetition)
  {
    VectorXd u = -program_->g - G * y, s = bound - G.transpose() * x;
    u -= program_->H.selfadjointView<Eigen::Lower>() * x;
    const double left = std::max(largest(u) / size, largest(s) / reach);
    if (!(left > settled) || left > 0.5 * before)
      break;
    forward(u);
    R.transpose().solveInPlace(s);
    VectorXd p = Q.transpose() * u - s;
    u -= Q * p;
    backward(u);
    R.solveInPlace(p);
    x += u, y += p, before = left;
  }
  z.setZero();
  for (std::size_t i = 0; i < active_.size(); ++i)
    z[active_[i]] = y[equations_ + i];
  return program_->kkt_residual(x, G.leftCols(equations_) * y.head(equations_), z);
}

bool ActiveSet::change()
{
  const VectorXd Cx = program_->C.transpose() * x;
  bool changed = false;
  for (Eigen::Index i = 0; i < z.size(); ++i)
  {
    const Side before = (*sides_)[i];
    Side now = before;
    if (before == between)
      now = Cx[i] < program_->lower[i] - aim ? at_lower : Cx[i] > program_->upper[i] + aim ? at_upper : between;
    else if (before * z[i] <= 0 && program_->lower[i] < program_->upper[i])
      now = between;
    changed = changed || now != before;
    (*sides_)[i] = now;
  }
  return changed;
}
} // namespace condyn
