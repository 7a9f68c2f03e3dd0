// A contact problem in numbers near one, by powers of two, so that nothing is rounded.
//
//   G' = S G S,    g' = S g / w,    lam = w S lam'
#pragma once
#include "contact_problem.hpp"
#include <cmath>

namespace condyn
{
inline double power_of_two(double x)
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
  static constexpr double apart = 64.0; // ratio of how far impulses move contacts, from which each has its unit

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
} // namespace condyn
