// A strictly convex quadratic program, and what is left of its optimality.
//
//   min  1/2 x^T H x + g^T x    with    A^T x = b,    lower <= C^T x <= upper
//
//   H x + g + A y + C z = 0,    A^T x = b,    C^T x = clip(C^T x + z, lower, upper)
#pragma once
#include "largest.hpp"

namespace condyn
{
using Eigen::MatrixXd;
using Eigen::VectorXd;

struct QuadraticProgram
{
  MatrixXd H; // its lower triangle; nothing is between the first `split` unknowns and the others
  Eigen::Index split;
  VectorXd g;
  MatrixXd A; // (n, p): a column an equation
  VectorXd b;
  MatrixXd C; // (n, r): a column an inequality
  VectorXd lower, upper;

  /// The largest of the three; that of the gradient relative to its largest term. `pull` is A y. Bounds that
  /// are crossed leave what one of them is violated by.
  double kkt_residual(const VectorXd & x, const VectorXd & pull, const VectorXd & z) const
  {
    const VectorXd Hx = H.selfadjointView<Eigen::Lower>() * x, Cx = C.transpose() * x;
    const double size = 1.0 + std::max(largest(g), largest(Hx));
    const VectorXd nearest = (Cx + z / size).cwiseMax(lower).cwiseMin(upper);
    const VectorXd gradient = (Hx + g + pull + C * z) / size;
    const VectorXd missed = A.transpose() * x - b;
    const double crossed = largest((lower - nearest).cwiseMax(0.0));
    return largest(Eigen::Vector4d(largest(gradient), largest(missed), largest(Cx - nearest), crossed));
  }
};
} // namespace condyn
