// The natural map of a contact problem, which is zero where it is solved, and its derivative.
//
//   F(lam) = lam - P_K(lam - d(lam)),    F' = 1 - P_K' (1 - d' G)
//
// `condyn_pin/contact/solvers/newton.py` has the same in Python, where each is derived.
#pragma once
#include "contact_problem.hpp"
#include <cmath>

namespace condyn
{
class NaturalMap
{
public:
  struct Point
  {
    VectorXd F, x, sigma; // x = lam - d is projected
    double size; // |F|
  };

  explicit NaturalMap(const ContactProblem & problem) : problem(problem) {}

  Point at(const VectorXd & lam) const
  {
    Point point;
    point.sigma = problem.velocities(lam);
    point.x = lam - problem.dual(point.sigma);
    point.F = lam - problem.project(point.x);
    point.size = point.F.norm();
    return point;
  }

  /// d' of a cone: 1, and mu sigma_t / |sigma_t| in the normal row.
  Eigen::Matrix3d dual_derivative(const Point & point, int i) const
  {
    Eigen::Matrix3d E = Eigen::Matrix3d::Identity();
    const auto t = point.sigma.segment<2>(3 * i);
    const double slip = std::hypot(t[0], t[1]);
    E.block<1, 2>(2, 0) = problem.friction[i] / (slip > 0 ? slip : 1.0) * t.transpose();
    return E;
  }

  /// P_K' of a cone.
  Eigen::Matrix3d slope(const Point & point, int i) const
  {
    const auto t = point.x.segment<2>(3 * i);
    const double mu = problem.friction[i], slip = std::hypot(t[0], t[1]), n = point.x[3 * i + 2];
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
    const MatrixXd & G = problem.G;
    MatrixXd D(G.rows(), G.cols());
    for (int i = 0; i < problem.cones(); ++i)
    {
      const Eigen::Matrix3d P = slope(point, i);
      D.middleRows<3>(3 * i).noalias() = P * dual_derivative(point, i) * G.middleRows<3>(3 * i);
      D.block<3, 3>(3 * i, 3 * i) += Eigen::Matrix3d::Identity() - P;
    }
    for (int r = problem.lines(); r < problem.rows(); ++r)
    {
      const bool free = r < problem.dry() ? point.x[r] > 0
                                           : std::abs(point.x[r]) < problem.limits[r - problem.dry()];
      if (free)
        D.row(r) = G.row(r);
      else
        D.row(r).setZero(), D(r, r) = 1;
    }
    return D;
  }

  const ContactProblem & problem;
};
} // namespace condyn
