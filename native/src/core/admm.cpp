#include "admm.hpp"
#include "largest.hpp"
#include <pinocchio/math.hpp>
#include <cmath>

namespace condyn
{
// As in `ADMMSolverSettings` of Pinocchio.
namespace admm
{
constexpr double mu = 1e-6, tau = 0.5, relative = 1e-14;
constexpr double apart = 10, regular = 1e-8; // ratio of residuals from which rho is changed
constexpr double least_rho = 1e-6, most_rho = 1e6, spectral_power = 0.2;
constexpr double precise = 1e-8; // the largest eigenvalue, from which rho begins
// What is asked for, as a share of the tolerance: its own measure is up to three times smaller than the natural
// residual. `_SHARE` in Python.
constexpr double share = 0.25;
} // namespace admm

double Admm::first_rho() const
{
  MatrixXd damped = problem_.G;
  damped.diagonal().array() += admm::mu;
  double stiffest = damped(0, 0);
  if (damped.rows() > 1)
  {
    const pinocchio::LanczosDecompositionTpl<MatrixXd> lanczos(damped, damped.rows());
    stiffest = pinocchio::computeLargestEigenvalue(lanczos.Ts(), admm::precise);
  }
  if (std::isnan(stiffest))
    stiffest = 1;
  const double rho = std::sqrt(stiffest * admm::mu) * std::pow(stiffest / admm::mu, admm::spectral_power);
  return std::max(std::min(rho, admm::most_rho), admm::least_rho);
}

void Admm::factorise(double rho)
{
  MatrixXd damped = problem_.G;
  damped.diagonal().array() += admm::mu + admm::tau * rho;
  factor_.compute(damped);
}

/// The largest of |z . y| of a contact; of dry friction what z would still do with what is left of its limit.
double Admm::not_complementary(const VectorXd & z, const VectorXd & y) const
{
  double worst = 0;
  for (int i = 0; i < problem_.cones(); ++i)
    worst = std::max(worst, std::abs(y.segment<3>(3 * i).dot(z.segment<3>(3 * i))));
  for (int r = problem_.lines(); r < problem_.dry(); ++r)
    worst = std::max(worst, std::abs(y[r] * z[r]));
  for (int r = problem_.dry(); r < problem_.rows(); ++r)
  {
    const double most = problem_.limits[r - problem_.dry()];
    worst = std::max(worst, z[r] > 0 ? z[r] * (y[r] + most) : -z[r] * (most - y[r]));
  }
  return worst;
}

/// How far z is from the dual of K; that of an interval is everything.
double Admm::not_dual(const VectorXd & z) const
{
  double worst = 0;
  for (int i = 0; i < problem_.cones(); ++i)
  {
    const double m = problem_.friction[i], n = z[3 * i + 2], t = std::hypot(z[3 * i], z[3 * i + 1]);
    // a z outside has its nearest point on the surface n = m t, or at the apex
    const double beyond = std::max(m * t - n, 0.0), surface = (t + m * n) / (1 + m * m);
    if (beyond > 0)
      worst = std::max(worst, surface > 0 ? beyond / std::sqrt(1 + m * m) : std::hypot(t, n));
  }
  for (int r = problem_.lines(); r < problem_.dry(); ++r)
    worst = std::max(worst, -z[r]);
  return worst;
}

bool Admm::is_small(const Left & left, double z, double xy) const
{
  const double most = admm::share * asked_.tolerance;
  return left.complementarity <= most && left.dual <= most + admm::relative * z
    && left.primal <= most + admm::relative * xy;
}

VectorXd Admm::run(const VectorXd & begin)
{
  const VectorXd & g = problem_.g;
  VectorXd x = begin, y = problem_.project(begin), z = problem_.dual(problem_.velocities(y));
  if (not_complementary(z, y) <= admm::share * asked_.tolerance && not_dual(z) <= admm::share * asked_.tolerance)
    return y;
  double rho = first_rho(), missed_before = INFINITY;
  factorise(rho);
  Anderson memory(asked_.anderson);
  VectorXd ahead_x = x, ahead_z = z, from_x, from_z, y_before;
  for (int k = 0; k <= asked_.max_iterations; ++k)
  {
    if (k > 1)
    {
      memory.remember(x, z, z - from_z);
      ahead_x = x, ahead_z = z;
      memory.accelerate(ahead_x, ahead_z);
    }
    const double r = admm::tau * rho;
    from_x = ahead_x, from_z = ahead_z, y_before = y;
    y = problem_.project(from_x - from_z / r);
    double missed = largest(from_x - y);
    if (asked_.anderson > 1 && k > 1 && missed >= missed_before && memory.is_full())
    { // it leads astray: the iteration goes on by itself
      from_x = x, from_z = z;
      y = problem_.project(from_x - from_z / r);
      memory.forget();
      missed = largest(from_x - y);
    }
    missed_before = missed;
    // s is what d has more than sigma
    x = factor_.solve(r * y + admm::mu * from_x + from_z - g - (problem_.dual(from_z) - from_z));
    z = from_z - r * (x - y);
    const Left left{largest(x - y), std::max(admm::mu, r) * largest(x - from_x), not_complementary(z, y)};
    if (is_small(left, std::max(largest(g), largest(z)), std::max(largest(x), largest(y))))
      break;
    const bool stands = largest(x - from_x) <= admm::relative * largest(x)
      && largest(y - y_before) <= admm::relative * largest(y) && largest(z - from_z) <= admm::relative * largest(z);
    if (stands || !std::isfinite(left.primal))
      break;
    if (k > 0 && (left.primal > admm::apart * left.dual || left.dual > admm::apart * left.primal))
    {
      rho *= std::sqrt(left.primal / (left.dual + admm::regular));
      rho = std::max(std::min(rho, admm::most_rho), admm::least_rho);
      factorise(rho);
    }
  }
  return y;
}
} // namespace condyn
