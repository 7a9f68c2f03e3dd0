#include "contact_solve.hpp"
#include "sticking.hpp"
#include <cmath>
#include <limits>

// Newton's method on the natural map of a normalised problem, as `condyn_pin/contact/natural_map.py` has it:
//
//   F(lam) = lam - P_K(lam - d(lam)) = 0,    F' = 1 - P_K' (1 - d' G)

namespace condyn
{
namespace
{
constexpr double eps = std::numeric_limits<double>::epsilon();
constexpr double rounding = 4 * eps; // a residual that is nothing, relative to the impulses
constexpr int steps_at_most = 50, halvings = 20, slips_at_most = 8;
constexpr double redundant = 1e-12; // singular values of F' that steps ignore
constexpr double along_nothing = 0.5, behind = 1e-3; // as in Python: `_ALONG`, `_BEHIND`
constexpr double contradiction = 1e-6, felt = 0.01; // as in Python: `_SMALL`, `_FELT` of consistent.py
constexpr double still_moved = 1e-12; // eigenvalues of G that are none: `CONTACT_RANK`
constexpr int contradictions = 2; // that are taken out of a step, one after the other
constexpr double apart = 64.0; // ratio of how far impulses move contacts, from which each has its unit

double power_of_two(double x)
{
  int exponent;
  std::frexp(x, &exponent);
  return std::ldexp(1.0, exponent - 1);
}

/// The same problem in numbers near one, and the unit of its impulses in each row: powers of two.
struct Normalised
{
  ContactProblem problem;
  VectorXd unit;

  explicit Normalised(const ContactProblem & given) : problem(given)
  {
    if (given.half_lines || given.limits.size() || differ(given))
      by_contact(given);
    else
    {
      const Scale scale(given);
      const double softer = 1.0 / power_of_two(scale.stiff), slower = 1.0 / power_of_two(scale.speed);
      problem.G *= softer, problem.g *= slower;
      unit.setConstant(given.rows(), softer / slower);
    }
  }

private:
  static bool differ(const ContactProblem & given)
  {
    double least = INFINITY, most = 0;
    for (int i = 0; i < given.cones(); ++i)
    {
      const double stiff = given.G.diagonal().segment<3>(3 * i).sum();
      least = std::min(least, stiff), most = std::max(most, stiff);
    }
    return given.cones() && most > apart * least;
  }

  void by_contact(const ContactProblem & given)
  {
    VectorXd S(given.rows());
    const auto share = [](double mean) {
      int exponent;
      std::frexp(mean > 0 ? mean : 1.0, &exponent);
      return std::ldexp(1.0, -int(std::floor(exponent / 2.0)));
    };
    for (int i = 0; i < given.cones(); ++i)
      S.segment<3>(3 * i).setConstant(share(given.G.diagonal().segment<3>(3 * i).sum() / 3));
    for (int r = given.lines(); r < given.rows(); ++r)
      S[r] = share(given.G(r, r));
    problem.g = given.g.cwiseProduct(S);
    const double fast = problem.g.cwiseAbs().maxCoeff(), w = fast < 1e-150 ? 1.0 : power_of_two(fast);
    problem.g /= w;
    problem.G = S.asDiagonal() * given.G * S.asDiagonal();
    problem.limits = given.limits.cwiseQuotient(S.tail(given.limits.size())) / w;
    unit = S * w;
  }
};

class Newton
{
public:
  explicit Newton(const ContactProblem & problem) : problem_(problem) {}

  /// Where it ends, from impulses.
  VectorXd run(VectorXd lam)
  {
    Point point = at(lam);
    VectorXd best = lam;
    double least = point.size;
    for (int steps = 0, slips = 0; steps < steps_at_most && std::isfinite(point.size); ++steps)
    {
      if (point.F.cwiseAbs().maxCoeff() <= rounding * std::max(1.0, lam.cwiseAbs().maxCoeff()))
        break;
      const MatrixXd D = derivative(point);
      VectorXd step;
      if (!smallest_step(D, point.F, step))
        break;
      if (!descend(lam, step, point))
        if (slips++ >= slips_at_most || !until_one_changes(lam, point, D))
          break;
      if (point.size < least)
        best = lam, least = point.size;
    }
    return best;
  }

private:
  struct Point
  {
    VectorXd F, x, sigma; // x = lam - d is projected
    double size; // |F|
  };

  Point at(const VectorXd & lam) const
  {
    Point point;
    point.sigma = problem_.velocities(lam);
    point.x = lam - problem_.dual(point.sigma);
    point.F = lam - problem_.project(point.x);
    point.size = point.F.norm();
    return point;
  }

  /// The smallest step with D step = -F.
  static bool smallest_step(const MatrixXd & D, const VectorXd & F, VectorXd & step)
  {
    if (!D.allFinite())
      return false;
    Eigen::CompleteOrthogonalDecomposition<MatrixXd> factor(D.rows(), D.cols());
    factor.setThreshold(redundant);
    factor.compute(D);
    step = -factor.solve(F);
    return true;
  }

  /// Goes to the first of lam + step, + step/2, ... with a smaller residual.
  bool descend(VectorXd & lam, const VectorXd & step, Point & point) const
  {
    double share = 1.0;
    for (int k = 0; k < halvings; ++k, share /= 2)
    {
      const VectorXd there = lam + share * step;
      Point reached = at(there);
      if (reached.size < (1 - 1e-4 * share) * point.size)
      {
        lam = there, point = std::move(reached);
        return true;
      }
    }
    return false;
  }

  /// Adds as much of what changes no F as makes a contact stick, slide or open.
  bool until_one_changes(VectorXd & lam, Point & point, const MatrixXd & D) const
  {
    VectorXd y;
    if (!smallest_step(D, -(D * point.F), y)) // the part of F that D sees
      return false;
    y -= point.F;
    const double length = y.norm();
    if (!(length > along_nothing * point.size))
      return false;
    y /= length;
    const double far = first_change(point, y);
    if (!std::isfinite(far))
      return false;
    lam += (1 + behind) * far * y;
    point = at(lam);
    return true;
  }

  /// How far along y the first cone is that x enters or leaves, K or its polar cone.
  double first_change(const Point & point, const VectorXd & y) const
  {
    double first = INFINITY;
    const VectorXd Y = problem_.G * y;
    for (int i = 0; i < problem_.cones(); ++i)
    {
      const double mu2 = problem_.friction[i] * problem_.friction[i];
      const Eigen::Vector3d x = point.x.segment<3>(3 * i);
      const Eigen::Vector3d w = y.segment<3>(3 * i) - dual_derivative(point, i) * Y.segment<3>(3 * i);
      for (const Eigen::Vector3d & weights : {Eigen::Vector3d(1, 1, -mu2), Eigen::Vector3d(mu2, mu2, -1)})
      {
        const double a = w.dot(weights.cwiseProduct(w)), b = x.dot(weights.cwiseProduct(w));
        const double c = x.dot(weights.cwiseProduct(x));
        const double q = -(b + std::copysign(std::sqrt(b * b - a * c), b)); // no root: NaN
        for (double root : {q / a, c / q})
          if (root > rounding && root < first)
            first = root;
      }
    }
    return first;
  }

  /// d' of a cone: 1, and mu sigma_t / |sigma_t| in the normal row.
  Eigen::Matrix3d dual_derivative(const Point & point, int i) const
  {
    Eigen::Matrix3d E = Eigen::Matrix3d::Identity();
    const auto t = point.sigma.segment<2>(3 * i);
    const double slip = std::hypot(t[0], t[1]);
    E.block<1, 2>(2, 0) = problem_.friction[i] / (slip > 0 ? slip : 1.0) * t.transpose();
    return E;
  }

  /// P_K' of a cone.
  Eigen::Matrix3d slope(const Point & point, int i) const
  {
    const auto t = point.x.segment<2>(3 * i);
    const double mu = problem_.friction[i], slip = std::hypot(t[0], t[1]), n = point.x[3 * i + 2];
    if (mu * slip <= -n)
      return Eigen::Matrix3d::Zero();
    if (slip <= mu * n)
      return Eigen::Matrix3d::Identity();
    const double shrink = 1 / (1 + mu * mu), somewhere = slip > 0 ? slip : 1.0;
    const Eigen::Vector2d u = t / somewhere;
    const Eigen::Matrix2d along = u * u.transpose();
    Eigen::Matrix3d P;
    P.topLeftCorner<2, 2>() = mu * (mu * slip + n) * shrink / somewhere * (Eigen::Matrix2d::Identity() - along)
      + mu * mu * shrink * along;
    P.topRightCorner<2, 1>() = mu * shrink * u;
    P.bottomLeftCorner<1, 2>() = mu * shrink * u.transpose();
    P(2, 2) = shrink;
    return P;
  }

  /// 1 - P_K' (1 - d' G), any of the one-sided derivatives.
  MatrixXd derivative(const Point & point) const
  {
    const MatrixXd & G = problem_.G;
    MatrixXd D(G.rows(), G.cols());
    for (int i = 0; i < problem_.cones(); ++i)
    {
      const Eigen::Matrix3d P = slope(point, i);
      D.middleRows<3>(3 * i).noalias() = P * dual_derivative(point, i) * G.middleRows<3>(3 * i);
      D.block<3, 3>(3 * i, 3 * i) += Eigen::Matrix3d::Identity() - P;
    }
    for (int r = problem_.lines(); r < problem_.rows(); ++r)
    {
      const bool free = r < problem_.dry() ? point.x[r] > 0
                                           : std::abs(point.x[r]) < problem_.limits[r - problem_.dry()];
      if (free)
        D.row(r) = G.row(r);
      else
        D.row(r).setZero(), D(r, r) = 1;
    }
    return D;
  }

  const ContactProblem & problem_;
};

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
  if (sticks_first && stick(problem, lam))
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
