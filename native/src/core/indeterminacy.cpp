#include "indeterminacy.hpp"
#include "islands.hpp"
#include <cmath>

namespace condyn
{
namespace
{
constexpr double opened = 1e-9; // by how much, as `_OPENS`
constexpr double least_pivot = 1e-5; // below which rows may be combinations of others, as `_PIVOT`
constexpr int open_mode = 0, slide_mode = 2;

/// Whether impulses along all normals open all contacts that impulses move.
bool opens_all(const ContactProblem & problem)
{
  VectorXd e = VectorXd::Zero(problem.rows());
  const int contacts = problem.cones() + problem.half_lines;
  for (int i = 0; i < contacts; ++i)
    e[problem.normal(i)] = 1.0;
  const MatrixXd & G = problem.G;
  const VectorXd S = G * e;
  const double enough = opened * S.cwiseAbs().maxCoeff();
  for (int i = 0; i < contacts; ++i)
  {
    const int n = problem.normal(i);
    if (G(n, n) == 0.0)
      continue;
    const double mu = i < problem.cones() ? problem.friction[i] : 0.0;
    const double slip = mu > 0.0 ? mu * std::hypot(S[n - 2], S[n - 1]) : 0.0;
    if (!(S[n] - slip > enough))
      return false;
  }
  return true;
}

/// Whether a contact alone may hold what it touches without a force that asks for it: G_nn <= mu |G_nt|.
bool holds_alone(const ContactProblem & problem)
{
  const MatrixXd & G = problem.G;
  for (int i = 0; i < problem.cones(); ++i)
    if (const int n = problem.normal(i); problem.friction[i] > 0.0 && G(n, n) > 0.0)
      if (!(G(n, n) > problem.friction[i] * std::hypot(G(n - 2, n), G(n - 1, n))))
        return true;
  return false;
}

/// Whether all impulses do something: no row of G is a combination of others.
bool is_independent(const MatrixXd & G)
{
  const Eigen::LLT<MatrixXd> factor(G);
  if (factor.info() != Eigen::Success)
    return false;
  const VectorXd pivots = factor.matrixLLT().diagonal();
  return pivots.minCoeff() > least_pivot * pivots.maxCoeff();
}

bool is_redundant(const ContactProblem & problem, const Eigen::VectorXi & modes)
{
  std::vector<int> rows;
  for (int i = 0; i < modes.size(); ++i)
  {
    const int first = i < problem.cones() ? 3 * i : problem.lines() + i - problem.cones();
    for (int row = first; modes[i] != open_mode && row < first + (i < problem.cones() ? 3 : 1); ++row)
      if (problem.G(row, row) > 0.0)
        rows.push_back(row);
  }
  MatrixXd G = problem.G(rows, rows);
  const VectorXd size = G.diagonal().cwiseSqrt().cwiseInverse();
  G = size.asDiagonal() * G * size.asDiagonal();
  const Eigen::LLT<MatrixXd> factor(G);
  return factor.info() != Eigen::Success || !(factor.matrixLLT().diagonal().minCoeff() > least_pivot);
}

bool may_be_indeterminate_alone(const ContactProblem & problem, const VectorXd & lam, double moves)
{
  if (!(problem.friction.array() > 0.0).any()) // convex
    return false;
  if (holds_alone(problem))
    return true;
  if (is_independent(problem.G))
    return false;
  const Eigen::VectorXi modes = contact_modes(problem, lam, moves);
  bool slides = false, stays = true;
  for (int i = 0; i < problem.cones(); ++i)
  {
    const bool rubs = problem.friction[i] > 0.0;
    slides = slides || (rubs && modes[i] == slide_mode);
    stays = stays && (!rubs || (modes[i] != slide_mode && modes[i] != open_mode));
  }
  if (!stays && !opens_all(problem)) // of a wedge in which nothing moves all answers have that motion
    return true;
  return slides && modes.size() > 1 && is_redundant(problem, modes);
}
} // namespace

bool may_be_indeterminate(const ContactProblem & problem, const VectorXd & lam, double moves)
{
  if (!problem.rows())
    return false;
  const std::vector<Island> found = islands(problem);
  if (found.empty())
    return may_be_indeterminate_alone(problem, lam, moves);
  for (const Island & island : found)
    if (may_be_indeterminate_alone(island.problem, lam(island.rows), moves))
      return true;
  return false;
}
} // namespace condyn
