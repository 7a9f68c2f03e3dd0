#include "contact_problem.hpp"
#include "islands.hpp"
#include <cmath>
#include <limits>

namespace condyn
{
namespace
{
constexpr double still = 1e-150; // velocities below are none [m/s]
constexpr double eps = std::numeric_limits<double>::epsilon();
} // namespace

Scale::Scale(const ContactProblem & problem)
: stiff(problem.rows() ? problem.G.trace() / problem.rows() : 0.0)
, speed(problem.rows() ? problem.g.cwiseAbs().maxCoeff() : 0.0)
{
  if (stiff == 0.0)
    stiff = 1.0;
  if (speed < still)
    speed = 1.0;
}

VectorXd ContactProblem::dual(const VectorXd & sigma) const
{
  VectorXd d = sigma;
  for (int i = 0; i < cones(); ++i)
    d[3 * i + 2] += friction[i] * std::hypot(sigma[3 * i], sigma[3 * i + 1]);
  return d;
}

VectorXd ContactProblem::project(const VectorXd & x) const
{
  VectorXd nearest(x.size());
  for (int i = 0; i < cones(); ++i)
  {
    const double mu = friction[i], slip = std::hypot(x[3 * i], x[3 * i + 1]), along = x[3 * i + 2];
    // inside, the nearest point of the surface, or the apex where both are below it
    const double n = std::max(std::max(along, (mu * slip + along) / (1 + mu * mu)), 0.0), most = mu * n;
    const double kept = most / std::max(std::max(slip, most), std::numeric_limits<double>::min());
    nearest.segment<3>(3 * i) << kept * x[3 * i], kept * x[3 * i + 1], n;
  }
  for (int r = lines(); r < dry(); ++r)
    nearest[r] = std::max(x[r], 0.0);
  for (int r = dry(); r < rows(); ++r)
    nearest[r] = std::min(std::max(x[r], -limits[r - dry()]), limits[r - dry()]);
  return nearest;
}

namespace
{
double missed_by_a_cone(double mu, const double * l, const double * s)
{
  const double dn = s[2] + mu * std::hypot(s[0], s[1]);
  const double x1 = l[0] - s[0], x2 = l[1] - s[1], xn = l[2] - dn, slip = std::hypot(x1, x2);
  const auto largest = [](double a, double b, double c) {
    return std::max(std::abs(a), std::max(std::abs(b), std::abs(c)));
  };
  const bool held = l[2] >= 0 && std::hypot(l[0], l[1]) <= mu * l[2];
  const double stuck = held ? largest(s[0], s[1], s[2]) : std::numeric_limits<double>::infinity();
  if (mu * slip <= -xn) // the apex is nearest
    return std::min(largest(l[0], l[1], l[2]), stuck);
  if (slip <= mu * xn) // inside
    return held ? stuck : largest(s[0], s[1], dn);
  const double n = (mu * slip + xn) / (1 + mu * mu), share = mu * n / slip;
  return std::min(largest(l[0] - share * x1, l[1] - share * x2, l[2] - n), stuck);
}
} // namespace

double natural_residual(const ContactProblem & problem, const VectorXd & lam)
{
  if (!problem.rows())
    return 0.0;
  const Scale scale(problem);
  const double unit = scale.stiff / scale.speed;
  const VectorXd l = lam * unit, s = problem.velocities(lam) / scale.speed;
  if (!l.allFinite() || !s.allFinite())
    return std::numeric_limits<double>::quiet_NaN();
  double worst = eps * l.cwiseAbs().maxCoeff(); // d is lost beside an impulse that is huge
  for (int i = 0; i < problem.cones(); ++i)
    worst = std::max(worst, missed_by_a_cone(problem.friction[i], l.data() + 3 * i, s.data() + 3 * i));
  for (int r = problem.lines(); r < problem.dry(); ++r)
    worst = std::max(worst, std::abs(l[r] - std::max(l[r] - s[r], 0.0)));
  for (int r = problem.dry(); r < problem.rows(); ++r)
  {
    const double most = problem.limits[r - problem.dry()] * unit;
    worst = std::max(worst, std::abs(l[r] - std::min(std::max(l[r] - s[r], -most), most)));
  }
  return worst;
}

Eigen::VectorXi contact_modes(const ContactProblem & problem, const VectorXd & lam, double moves)
{
  enum { open, stick, slide };
  const int count = problem.cones() + problem.rows() - problem.lines();
  if (const std::vector<Island> apart = islands(problem); !apart.empty())
  {
    Eigen::VectorXi of_all(count);
    for (const Island & each : apart)
    {
      const Eigen::VectorXi its = contact_modes(each.problem, lam(each.rows), moves);
      int i = -1, before = -1;
      for (int row : each.rows) // three rows of a cone are one contact
      {
        const int contact = row < problem.lines() ? row / 3 : problem.cones() + row - problem.lines();
        if (contact != before)
          of_all[contact] = its[++i], before = contact;
      }
    }
    return of_all;
  }
  const Scale scale(problem);
  const double quiet = moves * scale.speed;
  const VectorXd s = problem.velocities(lam);
  Eigen::VectorXi modes(count);
  int contact = 0;
  for (; contact < problem.cones(); ++contact)
  {
    const int r = 3 * contact;
    const double mu = problem.friction[contact], slip = std::hypot(s[r], s[r + 1]);
    const double x1 = lam[r] - s[r] / scale.stiff, x2 = lam[r + 1] - s[r + 1] / scale.stiff;
    const double xn = lam[r + 2] - (s[r + 2] + mu * slip) / scale.stiff;
    modes[contact] = !(mu * std::hypot(x1, x2) > -xn) ? open : slip > quiet ? slide : stick;
  }
  for (int r = problem.lines(); r < problem.dry(); ++r)
    modes[contact++] = lam[r] - s[r] / scale.stiff > 0 ? stick : open;
  for (int r = problem.dry(); r < problem.rows(); ++r)
    modes[contact++] = std::abs(s[r]) > quiet ? slide : stick;
  return modes;
}
} // namespace condyn
