// The law of contacts, each in the mode that it has, linearised at impulses:
//
//   open   lam = 0
//   stick  sigma = 0
//   slide  sigma_n = 0,  lam_t + mu lam_n s = 0,  s = sigma_t / |sigma_t|
//
//   by_sigma dsigma + by_lam dlam + by_friction dmu = 0,    dsigma = G dlam + dg
//
// `ActiveSet` of Python is this law (`condyn_pin/gradients/routes/active_set.py`).
#pragma once
#include "contact_problem.hpp"

namespace condyn
{
class ContactLaw
{
public:
  /// Reads it off impulses that solve a problem to rounding; what is slower than the share `moves` of |g| sticks.
  void read(const ContactProblem & problem, const VectorXd & lam, double moves);

  /// Fills A = by_sigma G + by_lam (m, m), and B = [by_sigma, by_friction] (m, m + cones).
  void equations(const ContactProblem & problem, MatrixXd & A, MatrixXd & B) const;

  /// Fills lam by g (m, m) and by friction (m, cones), the least where contacts are redundant; false where that
  /// is in doubt.
  bool linearise(const ContactProblem & problem, MatrixXd & by_g, MatrixXd & by_friction) const;

  /// How far the nearest contact is from another mode, in units of the problem; INFINITY without contacts.
  double margin(const ContactProblem & problem) const;

  Eigen::VectorXi modes; // open, stick or slide: 0, 1 or 2

private:
  bool slides(const ContactProblem & problem, int cone) const;
  bool holds(const ContactProblem & problem, int row, int contact) const;

  VectorXd lam_, sigma_;
};
} // namespace condyn
