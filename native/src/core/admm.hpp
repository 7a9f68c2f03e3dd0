// Alternating directions on a normalised problem, as Pinocchio 4 takes them.
//
//   y <- P_K(x - z / r),    (G + mu + r) x = r y + mu x' + z - g - s,    z <- z - r (x - y)
//
// with s = (0, 0, f |z_t|), f the friction, x' the x before and r = rho / 2. At the end x = y is the impulse,
// and z what is dual to it. rho is changed where one of its two residuals is ten times the other; Anderson's
// acceleration takes x and z ahead.
#pragma once
#include "anderson.hpp"
#include "contact_problem.hpp"

namespace condyn
{
/// What the iteration is asked for.
struct Directions
{
  double tolerance; // of the natural residual
  int max_iterations, anderson; // points that the acceleration remembers
};

class Admm
{
public:
  Admm(const ContactProblem & problem, const Directions & asked) : problem_(problem), asked_(asked) {}

  /// Where it ends, from impulses.
  VectorXd run(const VectorXd & begin);

private:
  struct Left
  {
    double primal, dual, complementarity;
  };

  double first_rho() const;
  void factorise(double rho);
  double not_complementary(const VectorXd & z, const VectorXd & y) const;
  double not_dual(const VectorXd & z) const;
  bool is_small(const Left & left, double z, double xy) const;

  const ContactProblem & problem_;
  const Directions asked_;
  Eigen::LLT<MatrixXd> factor_; // of G + mu + r
};
} // namespace condyn
