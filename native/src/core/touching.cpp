#include "touching.hpp"

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
  for (int i = 0; i < with_gaps; ++i)
  {
    const int n = problem.normal(i);
    problem.g[n] += (bends[i] + plan.allowed(gaps[i])) / plan.dt;
    if (problem.G(n, n) == 0.0) // constraints hold it: it goes where they go
      problem.g[n] = std::max(problem.g[n], 0.0);
  }
}

/// Whether pushes may have to yield: unless y of what is pushed out, a little soft, is the answer of `yielding_gaps` in
/// `contact_scheme.py`, which then pushes as fast as each gap asks.
bool Touching::presses(const StepPlan & plan) const
{
  constexpr double soft = 1e-4, all = 0.99; // as `_YIELDS`, `_ALL`
  if (with_gaps < 2 || !(gaps.minCoeff() < -plan.at_rest))
    return false;
  const auto & G = problem.G;
  std::vector<int> pushed;
  for (int i = 0; i < with_gaps; ++i)
    if (gaps[i] < -plan.at_rest && G(problem.normal(i), problem.normal(i)) > 0.0)
      pushed.push_back(i);
  const auto wanted = [&](int i) { return -plan.allowed(gaps[i]) / plan.dt; };
  const Eigen::Index k = pushed.size();
  MatrixXd N(k, k);
  VectorXd y(k);
  for (Eigen::Index r = 0; r < k; ++r)
  {
    y[r] = wanted(pushed[r]) - bends[pushed[r]] / plan.dt;
    for (Eigen::Index c = 0; c < k; ++c)
      N(r, c) = G(problem.normal(pushed[r]), problem.normal(pushed[c]));
    N(r, r) *= 1.0 + soft;
  }
  y = N.ldlt().solve(y).eval();
  if (!(y.size() == 0 || y.minCoeff() >= 0.0))
    return true;
  for (int i = 0; i < with_gaps; ++i)
  {
    const int n = problem.normal(i);
    double moved = 0.0, feels = 0.0;
    for (Eigen::Index c = 0; c < k; ++c)
      moved += G(n, problem.normal(pushed[c])) * y[c], feels += std::abs(G(n, problem.normal(pushed[c])));
    if (!(G(n, n) > 0.0) || feels == 0.0)
      continue;
    const double got = moved + bends[i] / plan.dt;
    if (!(got >= (gaps[i] < -plan.at_rest ? all : 1.0) * wanted(i)))
      return true;
  }
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
      now -= 0.5 * lam[n] * plan.allowed(gaps[i]) / plan.dt;
      left += 0.5 * lam[n] * std::max(before[n], 0.0);
    }
  const double correction = now + std::min(left, std::max(all - now, 0.0)), rest = all - correction;
  return {std::min(rest, 0.0), correction, std::max(rest, 0.0)};
}
} // namespace condyn
