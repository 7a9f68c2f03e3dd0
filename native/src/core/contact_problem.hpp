// What contacts ask of impulses, as numbers; it knows no robot.
//
//   sigma = G lam + g,    K contains lam,    K* contains d = sigma + (0, 0, mu |sigma_t|),    lam . d = 0
//
// Rows: three of each cone (t1, t2, n), then half-lines, then intervals. `condyn_pin/contact` has the
// same in Python, where each formula is derived.
#pragma once
#include <Eigen/Dense>

namespace condyn
{
using Eigen::MatrixXd;
using Eigen::VectorXd;

struct ContactProblem
{
  MatrixXd G; // [1/kg]
  VectorXd g; // [m/s]
  VectorXd friction; // of the cones
  int half_lines = 0;
  VectorXd limits; // of the intervals [N s]

  int rows() const { return int(g.size()); }
  int cones() const { return int(friction.size()); }
  int lines() const { return 3 * cones(); } // the first row of a half-line
  int dry() const { return lines() + half_lines; } // the first row of an interval
  /// The row along which the gap of a cone or a half-line changes.
  int normal(int contact) const { return contact < cones() ? 3 * contact + 2 : lines() + contact - cones(); }

  VectorXd velocities(const VectorXd & lam) const { return G * lam + g; }
  /// sigma with mu |sigma_t| along the normals.
  VectorXd dual(const VectorXd & sigma) const;
  /// P_K(x).
  VectorXd project(const VectorXd & x) const;
};

/// The sizes that errors are measured by: the mean diagonal of G [1/kg], and |g| [m/s].
struct Scale
{
  double stiff, speed;
  explicit Scale(const ContactProblem & problem);
};

/// |lam - P_K(lam - d)|, or |sigma| of what sticks, without a unit: zero if and only if lam solves the problem. NaN if
/// a number is none.
double natural_residual(const ContactProblem & problem, const VectorXd & lam);

/// Open, stick or slide: 0, 1 or 2 for each contact of a problem that lam solves.
Eigen::VectorXi contact_modes(const ContactProblem & problem, const VectorXd & lam, double moves);
} // namespace condyn
