// Contacts that stick where they would close, and open where they would not:
//
//   G_AA lam_A = -g_A,    lam = 0 elsewhere,    A: contacts with g_n < 0, and all dry friction
//
// Redundant contacts share what they carry: the smallest impulses, rows weighted by the diagonal.
#pragma once
#include "contact_problem.hpp"
#include <vector>

namespace condyn
{
namespace sticking
{
// What G gets more on its diagonal, relative: one correction leaves the square of its share.
constexpr double more = 1e-9;

/// The smallest solution of G lam = -g; false where a row moves nothing.
inline bool solved(const MatrixXd & G, const VectorXd & g, VectorXd & lam)
{
  MatrixXd heavier = G;
  heavier.diagonal() *= 1 + more;
  const Eigen::LLT<Eigen::Ref<MatrixXd>> factor(heavier);
  if (factor.info() != Eigen::Success)
    return false;
  lam = -factor.solve(g);
  lam -= factor.solve(G * lam + g);
  return true;
}
} // namespace sticking

/// Impulses if no contact slides, which nobody has proved; false where there are none.
inline bool sticking_impulses(const ContactProblem & problem, VectorXd & lam)
{
  std::vector<int> rows;
  for (int i = 0; i < problem.cones(); ++i)
    if (problem.g[3 * i + 2] < 0)
      rows.insert(rows.end(), {3 * i, 3 * i + 1, 3 * i + 2});
  for (int r = problem.lines(); r < problem.rows(); ++r)
    if (r >= problem.dry() || problem.g[r] < 0)
      rows.push_back(r);
  if (int(rows.size()) == problem.rows())
    return sticking::solved(problem.G, problem.g, lam);
  lam.setZero(problem.rows());
  if (rows.empty())
    return true;
  VectorXd some;
  if (!sticking::solved(problem.G(rows, rows), problem.g(rows), some))
    return false;
  lam(rows) = some;
  return true;
}
} // namespace condyn
