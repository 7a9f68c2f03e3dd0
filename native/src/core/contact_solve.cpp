#include "contact_solve.hpp"
#include "newton.hpp"
#include "normalised.hpp"
#include "sticking.hpp"

namespace condyn
{
namespace
{
constexpr double contradiction = 1e-6, felt = 0.01; // as in Python: `_SMALL`, `_FELT` of consistent.py
constexpr double still_moved = 1e-12; // eigenvalues of G that are none: `CONTACT_RANK`
constexpr int contradictions = 2; // that are taken out of a step, one after the other

/// The end of Newton's method from impulses.
VectorXd refined(const ContactProblem & problem, const VectorXd & begin)
{
  const Normalised small(problem);
  return Newton(small.problem).run(begin.cwiseQuotient(small.unit)).cwiseProduct(small.unit);
}

/// Takes the part of g out that no motion of what touches has, as `condyn_pin/contact/consistent.py`
/// does; false if there is none, or it is not small.
///
///   g_A - Z Z^T g_A,    Z an orthonormal basis of G_AA z = 0
bool without_contradiction(ContactProblem & problem, const VectorXd & lam, double accuracy)
{
  const Scale scale(problem);
  const VectorXd sigma = problem.velocities(lam);
  std::vector<int> A;
  for (int i = 0; i < problem.cones(); ++i)
  {
    const bool presses = lam[3 * i + 2] * scale.stiff > std::abs(sigma[3 * i + 2]);
    if (presses && std::hypot(sigma[3 * i], sigma[3 * i + 1]) <= contradiction * scale.speed)
      A.insert(A.end(), {3 * i, 3 * i + 1});
    if (presses)
      A.push_back(3 * i + 2);
  }
  if (A.empty())
    return false;
  const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(problem.G(A, A));
  const VectorXd & values = eigen.eigenvalues(); // in rising order
  Eigen::Index count = 0;
  while (count < values.size() && values[count] <= still_moved * values[values.size() - 1])
    ++count;
  const auto Z = eigen.eigenvectors().leftCols(count);
  const VectorXd out = Z * (Z.transpose() * problem.g(A));
  const double largest = out.cwiseAbs().maxCoeff();
  if (!(felt * accuracy * scale.speed < largest && largest <= contradiction * scale.speed))
    return false;
  problem.g(A) -= out;
  return true;
}
} // namespace

double solve_contact(ContactProblem & problem, bool sticks_first, double accuracy, VectorXd & lam)
{
  lam.setZero(problem.rows());
  if (!problem.rows())
    return 0.0;
  if (sticks_first && sticking_impulses(problem, lam))
  {
    const double natural = natural_residual(problem, lam);
    if (natural <= accuracy)
      return natural;
  }
  lam = refined(problem, VectorXd::Zero(problem.rows()));
  double natural = natural_residual(problem, lam);
  for (int k = 0; k < contradictions && natural > accuracy && without_contradiction(problem, lam, accuracy); ++k)
  {
    lam = refined(problem, lam);
    natural = natural_residual(problem, lam);
  }
  return natural;
}
} // namespace condyn
