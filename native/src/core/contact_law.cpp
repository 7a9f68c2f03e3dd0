#include "contact_law.hpp"
#include <cmath>

namespace condyn
{
namespace
{
enum { open, stick, slide };
constexpr double redundant = 1e-10; // singular values that redundant contacts leave: `_REDUNDANT`
constexpr double doubtful = 100; // so much above or below that, nobody knows

/// The smallest X of A X = B; false where the rank of A is in doubt.
bool least(const MatrixXd & A, const MatrixXd & B, MatrixXd & X)
{
  if (!A.allFinite())
    return false;
  const Eigen::PartialPivLU<MatrixXd> factor(A);
  const double smallest = factor.matrixLU().diagonal().cwiseAbs().minCoeff(); // Eigen's estimate overlooks a zero
  if (smallest > 0.0 && factor.rcond() > doubtful * redundant)
  {
    X = factor.solve(B);
    return true;
  }
  Eigen::CompleteOrthogonalDecomposition<MatrixXd> orthogonal(A.rows(), A.cols());
  orthogonal.setThreshold(redundant);
  orthogonal.compute(A);
  const auto rank = orthogonal.rank();
  if (rank == A.cols())
    return false;
  const VectorXd pivots = orthogonal.matrixQTZ().diagonal().cwiseAbs();
  const double largest = orthogonal.maxPivot();
  if (rank && !(pivots.head(rank).minCoeff() > doubtful * redundant * largest))
    return false;
  if (!(pivots[rank] * doubtful <= redundant * largest))
    return false;
  X = orthogonal.solve(B);
  return true;
}
} // namespace

void ContactLaw::read(const ContactProblem & problem, const VectorXd & lam, double moves)
{
  lam_ = lam, sigma_ = problem.velocities(lam);
  modes = contact_modes(problem, lam, moves);
}

/// What sticks without friction holds nothing along the plane: it slides.
bool ContactLaw::slides(const ContactProblem & problem, int cone) const
{
  return modes[cone] == slide || (modes[cone] == stick && problem.friction[cone] == 0.0);
}

/// A stop that touches, or dry friction that sticks; friction of zero holds nothing.
bool ContactLaw::holds(const ContactProblem & problem, int row, int contact) const
{
  return modes[contact] == stick && (row < problem.dry() || problem.limits[row - problem.dry()] > 0.0);
}

void ContactLaw::equations(const ContactProblem & problem, MatrixXd & A, MatrixXd & B) const
{
  const int m = problem.rows(), cones = problem.cones();
  A = problem.G, B.setZero(m, m + cones);
  const auto fix = [&](int row, bool velocity) { // that, or the impulse
    if (velocity)
      B(row, row) = 1;
    else
      A.row(row).setZero(), A(row, row) = 1;
  };
  for (int i = 0; i < cones; ++i)
  {
    const int r = 3 * i;
    if (!slides(problem, i))
    {
      for (int k = r; k < r + 3; ++k)
        fix(k, modes[i] == stick);
      continue;
    }
    const double mu = problem.friction[i], slip = std::hypot(sigma_[r], sigma_[r + 1]), pressed = lam_[r + 2];
    const Eigen::Vector2d s = slip > 0 ? Eigen::Vector2d(sigma_.segment<2>(r) / slip) : Eigen::Vector2d::Zero();
    const Eigen::Vector2d across(s[1], -s[0]);
    B.block<2, 2>(r, r) = (slip > 0 ? mu * pressed / slip : 0.0) * across * across.transpose();
    B(r + 2, r + 2) = 1;
    A.middleRows<2>(r) = B.block<2, 2>(r, r) * problem.G.middleRows<2>(r);
    A.block<2, 2>(r, r) += Eigen::Matrix2d::Identity();
    A.block<2, 1>(r, r + 2) += mu * s;
    B.block<2, 1>(r, m + i) = pressed * s;
  }
  for (int r = problem.lines(), contact = cones; r < m; ++r, ++contact)
    fix(r, holds(problem, r, contact));
}

bool ContactLaw::linearise(const ContactProblem & problem, MatrixXd & by_g, MatrixXd & by_friction) const
{
  MatrixXd A, B;
  equations(problem, A, B);
  MatrixXd X;
  if (!least(A, B, X))
    return false;
  by_g = -X.leftCols(problem.rows()), by_friction = -X.rightCols(problem.cones());
  return true;
}

double ContactLaw::margin(const ContactProblem & problem) const
{
  if (!problem.rows())
    return INFINITY;
  const Scale scale(problem);
  const double unit = scale.stiff / scale.speed;
  const VectorXd x = lam_ * unit, y = sigma_ / scale.speed;
  double least = INFINITY;
  const auto off = [&](double distance) { least = std::min(least, distance); };
  for (int i = 0; i < problem.cones(); ++i)
  {
    const int r = 3 * i;
    const double mu = problem.friction[i], slip = std::hypot(y[r], y[r + 1]);
    if (modes[i] == open)
      off(y[r + 2]);
    else if (mu == 0.0)
      off(x[r + 2]);
    else
      off(std::min(x[r + 2], modes[i] == slide ? slip : mu * x[r + 2] - std::hypot(x[r], x[r + 1])));
  }
  int contact = problem.cones();
  for (int r = problem.lines(); r < problem.dry(); ++r)
    off(modes[contact++] == open ? y[r] : x[r]);
  for (int r = problem.dry(); r < problem.rows(); ++r, ++contact)
    if (modes[contact] == slide)
      off(std::abs(y[r]));
    else if (holds(problem, r, contact))
      off(problem.limits[r - problem.dry()] * unit - std::abs(x[r]));
  return least;
}
} // namespace condyn
