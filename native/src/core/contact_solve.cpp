#include "contact_solve.hpp"
#include "islands.hpp"
#include "newton.hpp"
#include "normalised.hpp"
#include "sticking.hpp"

namespace condyn
{
namespace
{
constexpr double contradiction = 1e-6, felt = 0.01; // as in Python: `_SMALL`, `_FELT` of consistent.py
constexpr double still_moved = 1e-12; // eigenvalues of G that are none: `CONTACT_RANK`
constexpr int rescue = 50; // steps of Newton's method from an answer that failed: `RESCUE` of admm.py
constexpr int many = 150; // rows from which Python's directions are by products, and Newton's method is here
constexpr double finest = 1e-14; // residual that no part of a problem has to beat: `FINEST`

/// Impulses that may be the answer, and their natural residual.
struct Impulses
{
  VectorXd lam;
  double natural;

  Impulses(const ContactProblem & problem, const VectorXd & lam) : lam(lam), natural(natural_residual(problem, lam)) {}
};

/// One way to answer a problem, from impulses.
class Attempts
{
public:
  Attempts(const ContactProblem & problem, const ContactMethod & method, double accuracy)
  : problem_(problem), method_(method), accuracy_(accuracy)
  {}

  /// What costs little where it is right, else what the method begins with.
  Impulses first() const
  {
    VectorXd lam = VectorXd::Zero(problem_.rows());
    if (method_.sticks_first && sticking_impulses(problem_, lam))
    {
      const Impulses stuck(problem_, lam);
      if (stuck.natural <= accuracy_)
        return stuck;
    }
    return attempt(VectorXd::Zero(problem_.rows()));
  }

  /// The best of an answer that is not accurate enough, and of what else there is to try.
  Impulses others(Impulses best) const
  {
    if (!alternates() || best.natural <= accuracy_)
      return best;
    if (method_.newton_first)
      better(best, directed(VectorXd::Zero(problem_.rows()), method_.directions));
    if (!(best.natural <= accuracy_))
      better(best, refined(best.lam, rescue));
    if (!(best.natural <= accuracy_) && method_.directions.anderson)
    {
      Directions by_itself = method_.directions;
      by_itself.anderson = 0;
      better(best, directed(VectorXd::Zero(problem_.rows()), by_itself));
    }
    return best;
  }

  /// All of it, from impulses.
  Impulses insist(const VectorXd & begin) const { return others(attempt(begin)); }

private:
  bool alternates() const { return method_.alternates && problem_.rows() < many; }

  void better(Impulses & best, const VectorXd & lam) const
  {
    const Impulses other(problem_, lam);
    if (other.natural < best.natural || std::isnan(best.natural))
      best = other;
  }

  Impulses attempt(const VectorXd & begin) const
  {
    if (!alternates() || method_.newton_first)
      return {problem_, refined(begin, method_.steps)};
    const VectorXd lam = directed(begin, method_.directions);
    return {problem_, method_.polish ? refined(lam, method_.polish) : lam};
  }

  VectorXd directed(const VectorXd & begin, const Directions & asked) const
  {
    const Normalised small(problem_);
    return Admm(small.problem, asked).run(begin.cwiseQuotient(small.unit)).cwiseProduct(small.unit);
  }

  /// The end of Newton's method.
  VectorXd refined(const VectorXd & begin, int steps) const
  {
    const Normalised small(problem_);
    VectorXd from = begin.cwiseQuotient(small.unit);
    if (!from.allFinite())
      from.setZero();
    return Newton(small.problem).run(from, steps).cwiseProduct(small.unit);
  }

  const ContactProblem & problem_;
  const ContactMethod & method_;
  const double accuracy_;
};

/// The answers of all islands of a problem as one: `answer` is asked of each, with where to begin.
template<typename F>
Impulses apart(
  const ContactProblem & problem, const ContactMethod & method, double accuracy, const VectorXd & begin,
  const F & answer)
{
  const std::vector<Island> found = islands(problem);
  if (found.empty())
    return answer(Attempts(problem, method, accuracy), problem, begin);
  const Scale whole(problem);
  VectorXd lam(problem.rows());
  for (const Island & island : found)
  {
    const Scale part(island.problem); // whose errors are measured by the whole, too
    const double stricter = std::min(part.stiff * whole.speed / (whole.stiff * part.speed), 1.0);
    const Attempts attempts(island.problem, method, std::max(accuracy * stricter, finest));
    lam(island.rows) = answer(attempts, island.problem, VectorXd(begin(island.rows))).lam;
  }
  return {problem, lam};
}

/// Takes the part of g out that no motion of what touches has, as `condyn_pin/contact/solution.py`
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

double solve_contact(ContactProblem & problem, const ContactMethod & method, double accuracy, VectorXd & lam)
{
  lam.setZero(problem.rows());
  if (!problem.rows())
    return 0.0;
  const auto first = [](const Attempts & of, const ContactProblem &, const VectorXd &) { return of.first(); };
  const auto insist = [](const Attempts & of, const ContactProblem &, const VectorXd & begin) {
    return of.insist(begin);
  };
  const auto others = [](const Attempts & of, const ContactProblem & part, const VectorXd & begin) {
    return of.others({part, begin});
  };
  Impulses best = apart(problem, method, accuracy, lam, first);
  for (bool is_best : {false, true})
  {
    if (best.natural <= accuracy)
      break;
    // what is not finite contradicts nothing
    if (std::isfinite(best.natural) && without_contradiction(problem, best.lam, accuracy))
      best = apart(problem, method, accuracy, best.lam, insist);
    else if (!is_best)
      best = apart(problem, method, accuracy, best.lam, others);
  }
  lam = best.lam;
  return best.natural;
}
} // namespace condyn
