// How the end of a step with contacts changes with its start, each contact in its mode (`ContactLaw`):
//
//   M dv+ - J_b^T dl_b - J_c^T dlam = df,    J_b dv+ = ds,    dsigma = G dlam + J_c dv_0 + e
//   dlam = R dsigma_0 + R_mu dmu
//
// df, ds and e are what the balance of momentum, the constraints and the contacts leave by q and v at fixed v+
// and impulses (`Linearisation`, `ContactTurning`). With M = S^T S, V what constraints block, X = (1 - V V^T) S^-T J_c^T,
// Y = S^-1 X and Z = S^-1 V,
//
//   dv+ = P df + Y R e + (Z + Y R (V^T S^-T J_c^T)^T) h(ds) + Y R_mu dmu
//   P = M^-1 - Z Z^T + Y R Y^T = dv+/dp,    V h(ds) the least velocity with J_b v = ds
//
// df is zero where a coordinate neither carries a row nor is carried by it (`Carried`).
// `condyn_pin/gradients/routes/linear_steps.py` derives each.
#pragma once
#include "carried.hpp"
#include "contact_law.hpp"
#include "contact_steps.hpp"
#include "contact_turning.hpp"
#include "linearisation.hpp"
#include "moved_partials.hpp"

namespace condyn
{
/// What modes and margins are read by, as Python says it.
struct Readings
{
  double polished; // natural residual from which modes are read
  double falls; // g dt [m/s]
  std::vector<int> placed; // rows of constraints that have a position error
};

class StepDerivatives
{
public:
  /// Of steps that stay where they are.
  explicit StepDerivatives(ContactSteps & steps);
  StepDerivatives(const StepDerivatives &) = delete;

  /// Of the step that was taken last; false where it is left to Python.
  bool operator()(const Readings & readings);

  MatrixXd dq, dv; // q+ and v+ by q, v, tau and the friction of all cones (nv, 3 nv + cones), tangent
  double margin; // how far the nearest contact is from another mode, relative to the velocities
  Eigen::VectorXi modes; // of all candidates

private:
  void project();
  void linearise(const VectorXd & mean, const VectorXd & v1, const VectorXd & l_b);
  bool balance(const VectorXd & mean, const VectorXd & v1);
  MatrixXd slip(const VectorXd & v1);
  void ask();
  void turn_towards_end();
  MatrixXd solved(const MatrixXd & f, const MatrixXd & s) const;
  bool touched();
  bool untouched();
  void move();
  bool close(const Readings & readings);
  bool close(
    const TreeFactor & factor, const Blocked & blocked, const VectorXd & begin, const VectorXd & end, bool is_of_step,
    const std::vector<int> & placed);
  void read_margin(double falls);

  ContactSteps & steps_;
  const Scene & scene_;
  Scene weightless_;
  Mechanics mechanics_;
  Linearisation linearisation_, of_moves_;
  MovedPartials moved_partials_;
  ContactTurning turning_;
  ContactLaw law_;
  Loads no_loads_;
  Springs springs_;
  std::vector<Moved> moved_; // of each constraint
  Carried carried_;
  MatrixXd inverse_, Z_, Y_, YR_, P_; // M^-1 with what springs and damping add, and as above
  MatrixXd f_, e_; // df and e by q and v (nv, 2 nv), (m, 2 nv)
  MatrixXd before_, after_; // J_c v and J_c v+ of cones, by q
};
} // namespace condyn
