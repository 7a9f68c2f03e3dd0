#include "touching.hpp"
#include "nonnegative.hpp"
#include <algorithm>
#include <cmath>

namespace condyn
{
void Touching::choose(const Flags & flags, const Candidates & candidates, const StepPlan & plan)
{
  active = flags;
  chosen.clear();
  with_gaps = 0;
  int cones = 0;
  for (int i = 0; i < candidates.count(); ++i)
    if (active[i])
    {
      chosen.push_back(i);
      with_gaps += i < candidates.with_gaps();
      cones += i < candidates.cones();
    }
  problem.half_lines = with_gaps - cones;
  problem.friction.resize(cones);
  problem.limits.resize(chosen.size() - with_gaps);
  for (int i = 0; i < cones; ++i)
    problem.friction[i] = candidates.friction(chosen[i]);
  for (Eigen::Index i = 0; i < problem.limits.size(); ++i)
    problem.limits[i] = plan.dt * candidates.dry[chosen[with_gaps + i] - candidates.with_gaps()].limit;
}

void Touching::eliminate(const MatrixXd & all, const Candidates & candidates, const FreeStep & free)
{
  const int rows = problem.lines() + int(chosen.size()) - problem.cones();
  J_c.resize(rows, all.cols());
  int row = 0;
  for (int i : chosen)
  {
    J_c.middleRows(row, candidates.size(i)) = all.middleRows(candidates.first(i), candidates.size(i));
    row += candidates.size(i);
  }
  free.eliminate(J_c, X, blocked);
  before.noalias() = J_c * free.v;
}

void Touching::ask(const VectorXd & here, const VectorXd & bent, const FreeStep & free, const StepPlan & plan)
{
  gaps = here, bends = bent;
  problem.G.noalias() = X.transpose() * X;
  problem.g.noalias() = X.transpose() * free.free;
  if (free.blocked.rank)
    problem.g.noalias() += blocked.transpose() * free.held;
  yield(plan);
  for (int i = 0; i < with_gaps; ++i)
  {
    const int n = problem.normal(i);
    problem.g[n] += (bends[i] + allowed[i]) / plan.dt;
    if (problem.G(n, n) == 0.0) // constraints hold it: it goes where they go
      problem.g[n] = std::max(problem.g[n], 0.0);
  }
}

/// How far gaps may close, where pushes give way to each other and to what touches: `yielding_gaps` of
/// `contact_scheme.py`, island by island.
void Touching::yield(const StepPlan & plan)
{
  allowed.resize(with_gaps);
  for (int i = 0; i < with_gaps; ++i)
    allowed[i] = plan.allowed(gaps[i]);
  if (with_gaps < 2 || !(allowed.minCoeff() < 0.0))
    return;
  const auto felt = [&](int i, int j) { return problem.G(problem.normal(i), problem.normal(j)); };
  std::vector<int> left; // all else is held by constraints
  for (int i = with_gaps - 1; i >= 0; --i)
    if (felt(i, i) > 0.0)
      left.push_back(i);
  while (!left.empty())
  {
    std::vector<int> island{left.back()};
    left.pop_back();
    for (std::size_t k = 0; k < island.size(); ++k)
      for (std::size_t j = left.size(); j-- > 0;)
        if (felt(island[k], left[j]) != 0.0)
          island.push_back(left[j]), left.erase(left.begin() + j);
    std::sort(island.begin(), island.end());
    if (island.size() > 1 && VectorXd(allowed(island)).minCoeff() < 0.0)
      follow(island, plan.dt);
  }
}

/// Of the velocities wanted, p or -gap / dt, those that a motion can follow:
///
///   y = argmin_{y >= 0}  y . (G_nn + soft) y / 2 - ask . y,    p' = min(p, G_nn y)
void Touching::follow(const std::vector<int> & island, double dt)
{
  // as `_YIELDS`, `_HARD`, `_ALL`, `_NONE`, `_BUT_ROUNDING`; and what sinks
  constexpr double yields = 1e-4, hard = 1e-10, all = 0.99, none = 1e-3, but_rounding = 1.0 - 1e-6, sinks = 1e-6;
  std::vector<int> n;
  for (int i : island)
    n.push_back(problem.normal(i));
  const VectorXd size = problem.G.diagonal()(n).cwiseSqrt(), inverse = size.cwiseInverse();
  const MatrixXd S = inverse.asDiagonal() * problem.G(n, n) * inverse.asDiagonal();
  const VectorXd wanted = -allowed(island) / dt, bent = bends(island) / dt;
  VectorXd ask = inverse.cwiseProduct(wanted - bent), got;
  VectorXd soft = (wanted.array() > 0.0).select(VectorXd::Constant(n.size(), yields), hard);
  if (!std::isfinite(S.sum() + ask.sum())) // which the step finds out
    return;
  for (std::size_t again = 0; again <= n.size(); ++again)
  {
    const Eigen::LLT<MatrixXd> factor(S + MatrixXd(soft.asDiagonal()));
    VectorXd y;
    if (!nonnegative_least_squares(factor.matrixU(), factor.matrixL().solve(ask), y))
      return;
    got = size.cwiseProduct(S * y) + bent;
    bool any = false;
    for (std::size_t r = 0; r < n.size(); ++r)
      if (got[r] < -sinks * wanted.maxCoeff() && soft[r] == yields)
        soft[r] = hard, ask[r] = -bent[r] * inverse[r], any = true;
    if (!any)
      break;
  }
  for (std::size_t r = 0; r < n.size(); ++r)
    if (wanted[r] > 0.0 && got[r] < all * wanted[r])
      allowed[island[r]] = -dt * (got[r] <= none * wanted[r] ? 0.0 : std::min(got[r], wanted[r]) * but_rounding);
}

/// Whether a gap is pushed out by less than it would be alone: nothing can follow.
bool Touching::is_pressed(int i, const StepPlan & plan, double share) const
{
  const double alone = plan.allowed(gaps[i]);
  return alone < 0.0 && allowed[i] > share * alone;
}

/// Whether that is so of one that is deep, of which Python has a notice.
bool Touching::contradicts(const StepPlan & plan) const
{
  constexpr double seen = 1e-6, half = 0.5; // as `_SEEN` [m, rad] and `_HALF` of `step_problem.py`
  for (int i = 0; i < with_gaps; ++i)
    if (gaps[i] < -seen && is_pressed(i, plan, half))
      return true;
  return false;
}

void Touching::forget_held()
{
  for (int i = 0; i < with_gaps; ++i)
  {
    const int n = problem.normal(i), size = i < problem.cones() ? 3 : 1;
    if (problem.G.diagonal().segment(n + 1 - size, size).isZero(0.0))
      lam.segment(n + 1 - size, size).setZero();
  }
}

//   W = lam . (J_c v + J_c v+) / 2,    pushed out: lam_n p / 2
Vector3d Touching::work(const StepPlan & plan) const
{
  if (!lam.size())
    return Vector3d::Zero();
  const double all = 0.5 * lam.dot(before + J_c * v1);
  double now = 0, left = 0;
  for (int i = 0; i < with_gaps; ++i)
    if (gaps[i] < -plan.at_rest)
    {
      const int n = problem.normal(i);
      now -= 0.5 * lam[n] * allowed[i] / plan.dt;
      left += 0.5 * lam[n] * std::max(before[n], 0.0);
    }
  const double correction = now + std::min(left, std::max(all - now, 0.0)), rest = all - correction;
  return {std::min(rest, 0.0), correction, std::max(rest, 0.0)};
}
} // namespace condyn
