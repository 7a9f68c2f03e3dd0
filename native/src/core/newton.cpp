#include "newton.hpp"
#include <limits>

namespace condyn
{
namespace
{
constexpr double rounding = 4 * std::numeric_limits<double>::epsilon(); // a residual that is nothing, relative
constexpr int halvings = 20, slips_at_most = 8;
constexpr double ignored = 1e-12; // singular values of F' that steps ignore
constexpr double regular = 1e-8; // and those of an F' that has none of them, without a doubt
constexpr double along_nothing = 0.5, behind = 1e-3; // as in Python: `_ALONG`, `_BEHIND`

/// The smallest step with D step = -F.
bool smallest_step(const MatrixXd & D, const VectorXd & F, VectorXd & step)
{
  if (!D.allFinite())
    return false;
  const Eigen::PartialPivLU<MatrixXd> fast(D);
  if (fast.rcond() > regular)
  {
    step = -fast.solve(F);
    return true;
  }
  Eigen::CompleteOrthogonalDecomposition<MatrixXd> factor(D.rows(), D.cols());
  factor.setThreshold(ignored);
  factor.compute(D);
  step = -factor.solve(F);
  return true;
}
} // namespace

VectorXd Newton::run(VectorXd lam, int steps_at_most) const
{
  Point point = map_.at(lam);
  VectorXd best = lam;
  double least = point.size;
  for (int steps = 0, slips = 0; steps < steps_at_most && std::isfinite(point.size); ++steps)
  {
    if (point.F.cwiseAbs().maxCoeff() <= rounding * std::max(1.0, lam.cwiseAbs().maxCoeff()))
      break;
    const MatrixXd D = map_.derivative(point);
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

/// Goes to the first of lam + step, + step/2, ... with a smaller residual.
bool Newton::descend(VectorXd & lam, const VectorXd & step, Point & point) const
{
  double share = 1.0;
  for (int k = 0; k < halvings; ++k, share /= 2)
  {
    const VectorXd there = lam + share * step;
    Point reached = map_.at(there);
    if (reached.size < (1 - 1e-4 * share) * point.size)
    {
      lam = there, point = std::move(reached);
      return true;
    }
  }
  return false;
}

/// Adds as much of what changes no F as makes a contact stick, slide or open.
bool Newton::until_one_changes(VectorXd & lam, Point & point, const MatrixXd & D) const
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
  point = map_.at(lam);
  return true;
}

/// How far along y the first cone is that x enters or leaves, K or its polar cone.
double Newton::first_change(const Point & point, const VectorXd & y) const
{
  double first = INFINITY;
  const VectorXd Y = map_.problem.G * y;
  for (int i = 0; i < map_.problem.cones(); ++i)
  {
    const double mu2 = map_.problem.friction[i] * map_.problem.friction[i];
    const Eigen::Vector3d x = point.x.segment<3>(3 * i);
    const Eigen::Vector3d w = y.segment<3>(3 * i) - map_.dual_derivative(point, i) * Y.segment<3>(3 * i);
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
} // namespace condyn
