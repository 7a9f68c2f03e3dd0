#include "indeterminacy.hpp"
#include "contact_law.hpp"
#include "islands.hpp"
#include "newton.hpp"
#include "nonnegative.hpp"
#include "normalised.hpp"
#include "sticking.hpp"
#include <cmath>

namespace condyn
{
namespace
{
// As in Python, each by the name there.
constexpr double opened = 1e-9; // `_OPENS`
constexpr double balanced = 1e-9, touching = 1e-6; // `_BALANCED`, `_TOUCHING`
constexpr double no_motion = 1e-13, no_impulse = 1e-12; // `_NO_MOTION`; of the impulses that stop all contacts
constexpr double least_pivot = 1e-5; // `_PIVOT`
constexpr int most = 300; // `_MOST`
constexpr double left_open = 1e-9, moved = 1e-6; // `_LEFT`, `_MOVED`
constexpr int sides = 32; // `_SIDES`
constexpr double inside = 1 - 1e-6; // `_INSIDE`
constexpr int polish = 3; // `_POLISH`
constexpr int open_mode = 0, stick_mode = 1, slide_mode = 2;

int contacts(const ContactProblem & problem) { return problem.cones() + problem.half_lines; }

/// Whether all impulses do something: no row of G is a combination of others.
bool is_independent(const MatrixXd & G)
{
  const Eigen::LLT<MatrixXd> factor(G);
  if (factor.info() != Eigen::Success)
    return false;
  const VectorXd pivots = factor.matrixLLT().diagonal();
  return pivots.minCoeff() > least_pivot * pivots.maxCoeff();
}

// ------------------------------------------------------------------------------------------------
// Wedges.

/// Equal impulses along all normals.
VectorXd normals(const ContactProblem & problem)
{
  VectorXd e = VectorXd::Zero(problem.rows());
  for (int i = 0; i < contacts(problem); ++i)
    e[problem.normal(i)] = 1.0;
  return e;
}

/// Whether velocities open all contacts that impulses move, faster than these slip.
bool opens(const ContactProblem & problem, const VectorXd & S)
{
  const double enough = opened * S.cwiseAbs().maxCoeff();
  for (int i = 0; i < contacts(problem); ++i)
  {
    const int n = problem.normal(i);
    if (problem.G(n, n) == 0.0)
      continue;
    const double mu = i < problem.cones() ? problem.friction[i] : 0.0;
    const double slip = mu > 0.0 ? mu * std::hypot(S[n - 2], S[n - 1]) : 0.0;
    if (!(S[n] - slip > enough))
      return false;
  }
  return true;
}

/// Whether the motion that is nearest to one that opens all contacts alike does so.
bool opens_by_motion(const ContactProblem & problem, const MatrixXd & G)
{
  MatrixXd more = G;
  more.diagonal().array() += 1e-10;
  const Eigen::LLT<Eigen::Ref<MatrixXd>> factor(more);
  if (factor.info() != Eigen::Success)
    return false;
  VectorXd S = VectorXd::Zero(problem.rows());
  S.head(G.rows()) = G * factor.solve(normals(problem).head(G.rows()));
  return opens(problem, S);
}

/// Edges of polygons in the cones, and half-lines, of contacts that impulses move.
MatrixXd edges(const ContactProblem & problem)
{
  MatrixXd N = MatrixXd::Zero(problem.dry(), sides * contacts(problem));
  int column = 0;
  for (int i = 0; i < contacts(problem); ++i)
  {
    const int n = problem.normal(i);
    if (problem.G(n, n) == 0.0)
      continue;
    const double mu = i < problem.cones() ? inside * problem.friction[i] : 0.0;
    for (int k = 0; k < (mu > 0.0 ? sides : 1); ++k, ++column)
    {
      const double angle = 2 * M_PI * k / sides;
      N(n, column) = 1.0;
      if (mu > 0.0)
        N(n - 2, column) = mu * std::cos(angle), N(n - 1, column) = mu * std::sin(angle);
    }
  }
  return N.leftCols(column);
}

/// Whether contacts can carry something beside their load that does nothing: z in K, G z = 0, g . z = 0.
bool can_wedge(const ContactProblem & problem)
{
  if (opens(problem, problem.G * normals(problem)))
    return false;
  const Scale scale(problem);
  const int rows = problem.dry();
  const MatrixXd G = problem.G.topLeftCorner(rows, rows) / scale.stiff;
  if (!G.allFinite() || opens_by_motion(problem, G))
    return false;
  const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(G); // in rising order
  int dropped = 0;
  while (dropped < rows && !(eigen.eigenvalues()[dropped] > no_motion * G.trace()))
    ++dropped;
  const int kept = rows - dropped;
  MatrixXd X(kept + 1, rows);
  X.topRows(kept) = eigen.eigenvalues().tail(kept).cwiseSqrt().asDiagonal()
                    * eigen.eigenvectors().rightCols(kept).transpose();
  X.row(kept) = problem.g.head(rows).transpose() / scale.speed;
  const MatrixXd N = edges(problem);
  if (!N.cols())
    return false;
  MatrixXd A(kept + 2, N.cols());
  A << X * N, VectorXd::Ones(N.cols()).transpose();
  VectorXd x;
  if (!nonnegative_least_squares(A, VectorXd::Unit(kept + 2, kept + 1), x))
    return true; // nothing is proved
  const VectorXd z = N * x;
  const double size = z.cwiseAbs().maxCoeff();
  return (G * z).cwiseAbs().maxCoeff() <= balanced * size && std::abs(X.row(kept).dot(z)) <= touching * size;
}

/// Whether all that closes can stick: then nothing moves in any answer of a wedge.
bool sticks(const ContactProblem & problem, double accuracy)
{
  VectorXd lam;
  return sticking_impulses(problem, lam) && natural_residual(problem, lam) <= accuracy;
}

// ------------------------------------------------------------------------------------------------
// Redundant contacts that slide.

bool slides(const ContactProblem & problem, const Eigen::VectorXi & modes)
{
  for (int i = 0; i < problem.cones(); ++i)
    if (modes[i] == slide_mode && problem.friction[i] > 0.0)
      return true;
  return false;
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
  const VectorXd size = problem.G.diagonal()(rows).cwiseSqrt().cwiseInverse();
  const Eigen::LLT<MatrixXd> factor(size.asDiagonal() * problem.G(rows, rows) * size.asDiagonal());
  return factor.info() != Eigen::Success || !(factor.matrixLLT().diagonal().minCoeff() > least_pivot);
}

/// Modes in which contacts that touch without a load are closed, too: an answer may be at the end of its continuum.
Eigen::VectorXi closed_modes(const ContactProblem & problem, const VectorXd & lam, double moves)
{
  Eigen::VectorXi modes = contact_modes(problem, lam, moves);
  const VectorXd sigma = problem.velocities(lam);
  const double still = moves * Scale(problem).speed;
  for (int i = 0; i < problem.cones(); ++i)
    if (modes[i] == open_mode && sigma[3 * i + 2] <= still)
      modes[i] = sigma.segment<2>(3 * i).cwiseAbs().maxCoeff() > still ? slide_mode : stick_mode;
  return modes;
}

/// Whether the equations of modes in which contacts slide leave velocities open.
bool slides_in_several_ways(const ContactProblem & problem, const VectorXd & lam, double moves)
{
  const Eigen::VectorXi modes = closed_modes(problem, lam, moves);
  if (!slides(problem, modes) || !is_redundant(problem, modes))
    return false;
  const Normalised small(problem);
  ContactLaw law;
  law.read(small.problem, Newton(small.problem).run(lam.cwiseQuotient(small.unit), polish), moves);
  law.modes = modes;
  MatrixXd A, B;
  law.equations(small.problem, A, B);
  if (!A.allFinite())
    return false;
  A.rowwise().normalize();
  const Eigen::BDCSVD<MatrixXd> svd(A, Eigen::ComputeFullV);
  const VectorXd & values = svd.singularValues();
  for (int k = 0; k < values.size(); ++k)
    if (values[k] <= left_open * values[0] && (small.problem.G * svd.matrixV().col(k)).cwiseAbs().maxCoeff() > moved)
      return true;
  return false;
}

// ------------------------------------------------------------------------------------------------
// Painleve.

/// Whether a contact may hold what it touches without a force that asks for it: G_nn <= mu |G_nt|.
bool holds_alone(const ContactProblem & problem)
{
  const MatrixXd & G = problem.G;
  for (int i = 0; i < problem.cones(); ++i)
    if (const int n = problem.normal(i); problem.friction[i] > 0.0 && G(n, n) > 0.0)
      if (!(G(n, n) > problem.friction[i] * std::hypot(G(n - 2, n), G(n - 1, n))))
        return true;
  return false;
}

/// Whether no impulses, or those that stop all contacts, lead to another answer.
bool has_another_answer(const ContactProblem & problem, const VectorXd & lam, double solved)
{
  if (!holds_alone(problem))
    return false;
  if (contacts(problem) + int(problem.limits.size()) == 1) // whose answers Python enumerates
    return true;
  const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(problem.G);
  const VectorXd & values = eigen.eigenvalues();
  const double least = no_impulse * values.cwiseAbs().maxCoeff();
  const VectorXd inverse = (values.array().abs() > least).select(values.cwiseInverse(), 0.0);
  const VectorXd stuck
    = -eigen.eigenvectors() * inverse.cwiseProduct(eigen.eigenvectors().transpose() * problem.g);
  const VectorXd sigma = problem.velocities(lam);
  const double enough = moved * Scale(problem).speed;
  for (VectorXd other : {VectorXd(VectorXd::Zero(problem.rows())), stuck})
  {
    if (!(natural_residual(problem, other) <= solved))
    {
      const Normalised small(problem);
      other = Newton(small.problem).run(other.cwiseQuotient(small.unit), 4 * polish).cwiseProduct(small.unit);
    }
    if (natural_residual(problem, other) <= solved
        && (problem.velocities(other) - sigma).cwiseAbs().maxCoeff() > enough)
      return true;
  }
  return false;
}

bool is_indeterminate_alone(const ContactProblem & problem, const VectorXd & lam, double moves, double accuracy)
{
  if (!(problem.friction.array() > 0.0).any()) // convex
    return false;
  if (problem.rows() <= most && !is_independent(problem.G))
  {
    if (can_wedge(problem))
      return !sticks(problem, accuracy);
    if (slides_in_several_ways(problem, lam, moves))
      return true;
  }
  return has_another_answer(problem, lam, accuracy);
}
} // namespace

bool is_indeterminate(const ContactProblem & problem, const VectorXd & lam, double moves, double accuracy)
{
  if (!problem.rows())
    return false;
  const std::vector<Island> found = islands(problem);
  if (found.empty())
    return is_indeterminate_alone(problem, lam, moves, accuracy);
  for (const Island & island : found)
    if (is_indeterminate_alone(island.problem, lam(island.rows), moves, accuracy))
      return true;
  return false;
}
} // namespace condyn
