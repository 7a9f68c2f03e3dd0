#include "cascade.hpp"
#include <algorithm>
#include <cmath>

namespace condyn
{
namespace
{
constexpr double in_doubt = 1e-2; // relative: multipliers that are no nearer to a threshold are beyond doubt
constexpr double apart = 1e2; // norms that are farther from a threshold by this are
constexpr double twice = 2, decade = 10; // singular values that are farther from a threshold are
constexpr double met = 1e-10; // [m/s^2]: what equations may leave that agree
constexpr double at_bound = 0.1; // of the slack: nearer than what the levels above leave of it

/// Whether a norm is clearly above a threshold, or clearly below.
bool is_far(double norm, double threshold) { return !(norm > threshold / apart && norm < threshold * apart); }
} // namespace

Cascade::Cascade(const TickSpec & spec) : spec_(spec), levels_(spec.levels.size()) {}

double Cascade::solve(const QuadraticProgram & program, const Wishes & wishes, std::vector<Sides> & sides)
{
  changes = 0, answered = 1;
  if (levels_.size() == 1)
  {
    const double left = levels_[0].solve(program, sides[0], spec_.kkt);
    x = levels_[0].x, changes = levels_[0].changes;
    return left;
  }
  if (!begin(program))
    return none;
  double most = 0;
  int first = 0;
  for (std::size_t i = 0; i < levels_.size() && Z_.cols(); ++i)
  {
    ActiveSet & level = levels_[i];
    const int size = spec_.levels[i];
    write(program, wishes, first, size);
    if (!leave_slack())
      return none;
    const double left = level.solve(inner_, sides[i], spec_.kkt);
    if (!(left <= spec_.kkt))
      return none;
    most = std::max(most, left);
    x += Z_ * level.x;
    changes += level.changes, answered = int(i) + 1;
    if (i + 1 < levels_.size() && !narrow(wishes.G.middleCols(first, size), level))
      return none;
    first += size;
  }
  return most;
}

bool Cascade::begin(const QuadraticProgram & given)
{
  if (!null_.by_pivots(given.A, spec_.rank) && !null_.by_singular_values(given.A, spec_.rank, twice))
    return false;
  if (null_.rank() == given.A.rows())
    return false;
  x = null_.least(given.b), Z_ = null_.basis();
  return largest(given.A.transpose() * x - given.b) <= met;
}

void Cascade::write(const QuadraticProgram & given, const Wishes & wishes, int first, int size)
{
  const auto G = wishes.G.middleCols(first, size);
  const auto w = wishes.weights.segment(first, size);
  const Eigen::Index n = Z_.cols();
  G_.noalias() = Z_.transpose() * G;
  inner_.split = n;
  inner_.H.noalias() = G_ * w.asDiagonal() * G_.transpose();
  inner_.H.diagonal().array() += spec_.regularisation;
  inner_.g.noalias() = spec_.regularisation * (Z_.transpose() * x);
  inner_.g += G_ * w.cwiseProduct(G.transpose() * x - wishes.b.segment(first, size));
  inner_.A.resize(n, 0), inner_.b.resize(0);
  inner_.C.noalias() = Z_.transpose() * given.C;
  const VectorXd Cx = given.C.transpose() * x;
  inner_.lower = given.lower - Cx, inner_.upper = given.upper - Cx;
}

bool Cascade::leave_slack()
{
  const double slack = spec_.slack;
  for (Eigen::Index i = 0; i < inner_.lower.size(); ++i)
  {
    double &lower = inner_.lower[i], &upper = inner_.upper[i];
    if (lower > -slack && lower < 10 * slack)
      lower = -slack;
    if (upper < slack && upper > -10 * slack)
      upper = slack;
    const double norm = inner_.C.col(i).norm();
    if (!is_far(norm, spec_.decided))
      return false;
    if (norm > spec_.decided)
      continue;
    if (!(lower <= 0 && upper >= 0)) // out of reach
      return false;
    inner_.C.col(i).setZero();
    lower = -none, upper = none;
  }
  return true;
}

bool Cascade::narrow(const Eigen::Ref<const MatrixXd> & G, const ActiveSet & level)
{
  std::vector<int> active;
  if (has_other_multipliers(level) || !strictly_active(level.z, active))
    return false;
  kept_.resize(Z_.cols(), G_.cols() + active.size());
  kept_.leftCols(G_.cols()) = G_;
  for (std::size_t i = 0; i < active.size(); ++i)
    kept_.col(G_.cols() + i) = inner_.C.col(active[i]);
  if (!drop_decided(G))
    return false;
  if (!null_.by_pivots(kept_, spec_.rank) && !null_.by_singular_values(kept_, spec_.rank, decade))
    return false;
  Z_ = Z_ * null_.basis();
  return true;
}

bool Cascade::strictly_active(const VectorXd & z, std::vector<int> & active) const
{
  const double threshold = spec_.strictly * largest(z);
  const double doubt = in_doubt * threshold + spec_.kkt * (1 + largest(inner_.g));
  for (Eigen::Index i = 0; i < z.size(); ++i)
  {
    const double size = std::abs(z[i]);
    if (size && std::abs(size - threshold) <= doubt)
      return false;
    if (size > threshold)
      active.push_back(int(i));
  }
  return true;
}

bool Cascade::drop_decided(const Eigen::Ref<const MatrixXd> & G)
{
  const double most = kept_.colwise().norm().size() ? kept_.colwise().norm().maxCoeff() : 0.0;
  for (Eigen::Index i = 0; i < G.cols(); ++i)
  {
    const double threshold = spec_.decided * G.col(i).norm(), left = G_.col(i).norm();
    // a row that is nothing beside others has no part in the rank anyway
    if (!is_far(left, threshold) && left * apart > spec_.rank * most)
      return false;
    if (left <= threshold)
      kept_.col(i).setZero();
  }
  return true;
}

bool Cascade::has_other_multipliers(const ActiveSet & level)
{
  const VectorXd Cs = inner_.C.transpose() * level.x;
  std::vector<int> met;
  bool more = false; // than the active ones, which are independent
  for (Eigen::Index i = 0; i < Cs.size(); ++i)
  {
    const double room = std::min(Cs[i] - inner_.lower[i], inner_.upper[i] - Cs[i]);
    if (level.z[i] || room < at_bound * spec_.slack)
      met.push_back(int(i)), more = more || !level.z[i];
  }
  if (!more)
    return false;
  MatrixXd rows(inner_.C.rows(), met.size());
  for (std::size_t i = 0; i < met.size(); ++i)
    rows.col(i) = inner_.C.col(met[i]);
  return !null_.by_pivots(rows, spec_.rank) || null_.rank() < rows.cols();
}
} // namespace condyn
