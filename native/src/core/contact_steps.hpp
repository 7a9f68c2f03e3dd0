// Steps of Stewart and Trinkle: velocities that close the gaps of a step, with Coulomb's law.
//
//   M (v+ - v) = dt (tau - h) + J_b^T l_b + J_c^T lam,    J_b v+ = -dt gamma / 2
//   sigma = G lam + g,    g_n = J_n v_free + (s + gap) / dt  (gap > 0),  J_n v_free + (s + 0.2 gap) / dt  (gap < 0)
//   q+ = q (+) dt v+,     s = gap(q (+) dt v) - gap - dt J_n v
//
// Constraints are eliminated, with M = L L^T, V an orthonormal basis of what they block of L^T v, and V h the
// least L^T v with the J_b v that is asked for:
//
//   X = (1 - V V^T) L^-1 J_c^T,    G = X^T X,    L^T v_free = (1 - V V^T) (L^T v + L^-1 p) + V h
//
// `condyn_pin/simulation/integrators/contact_steps.py` derives each. What it answers in another way than by a
// first attempt of its contact solver is left to it.
#pragma once
#include "blocked.hpp"
#include "candidates.hpp"
#include "contact_problem.hpp"
#include "mechanics.hpp"
#include "rows.hpp"

namespace condyn
{
/// How steps are taken, as Python says it; its file `compiled/contacts.py` names where each number comes from.
struct StepPlan
{
  double dt; // [s]
  bool sticks_first; // whether contacts are first taken to stick
  double near, pushed_out, at_rest, touches; // of gaps [m, rad], and the share of a penetration
  double solved, moves; // natural residual, and what slides faster than that share of |g|
  double straight, missed; // where paths are looked at, and how far from where they should they may end [m, rad]
  double closed, small; // gaps of loops: left, and closed by the factors of the step [m, rad]
  double rank_tolerance; // of J_b L^-T
  double deep; // a penetration at the start that is none without a doubt [m, rad]
};

class ContactSteps
{
public:
  ContactSteps(const Scene & scene, const Candidates & candidates, int rank);
  ContactSteps(const ContactSteps &) = delete; // it refers to its own scene

  /// Gets ready for steps with torques applied (nv,).
  void begin(const StepPlan & plan, const VectorXd & applied);
  /// Gives contacts of the scene without an anchor the place where they are at q.
  void anchor(const VectorXd & q);
  /// Whether loops and contacts at a state are clearly where a motion may begin.
  bool fits(const VectorXd & q, const VectorXd & v, double closed);
  /// Whether a body turns further in a step than one chart goes.
  bool turns_too_far(const VectorXd & v) const;
  /// Takes a step; false where Python has to say what becomes of it.
  bool attempt(const VectorXd & q, const VectorXd & v);

  // The last step.
  VectorXd q, v, a; // at its end, and the mean acceleration
  double natural = 0; // residual of the contact problem
  Vector3d work; // of the contacts, of corrections, and what is algorithmic, as `ContactWork` of Python [J]
  VectorXd impulses(); // of constraints, then of all candidates [N s, N m s]
  Eigen::VectorXi modes() const; // of all candidates
  /// Natural residual, what is left of the balance of momentum [N s] and of J_b v+ [m/s], violation,
  /// penetration, energy lost, correction work and algorithmic work [J].
  void errors(double * eight);
  /// Violation, slip, kinetic and potential energy at a state.
  void measure(const VectorXd & q, const VectorXd & v, double * four);

  const Candidates & candidates;

private:
  using Flags = std::vector<char>;

  /// The contacts that take part, and what the step asks of them.
  struct Posed
  {
    Flags active; // of all candidates
    std::vector<int> chosen; // those that are active
    bool along_path = false; // whether contacts are taken where a path ends
    VectorXd path; // the velocity along it
    MatrixXd J_c, X, blocked; // rows, and L^-1 J_c^T along what is free and what is blocked
    VectorXd gaps, bends, before; // of what has a gap, and J_c v
    ContactProblem problem;
    VectorXd lam, v1; // the answer, and the velocity after it
    int with_gaps = 0; // how many of the chosen have a gap
  };

  bool pose_robot(const VectorXd & q, const VectorXd & v);
  bool factorise(const VectorXd & q, MatrixXd & M);
  void condense(const VectorXd & mean);
  void choose(const Flags & active);
  void pose();
  void pose_along(const VectorXd & u);
  void eliminate();
  void ask(const VectorXd & gaps, const VectorXd & bends);
  bool solve();
  bool answer();
  double off();
  bool close_loops();
  Vector3d work_of_contacts() const;
  double energy(const VectorXd & q, const VectorXd & v);
  void jacobian(MatrixXd & J);
  double allowed(double gap) const;
  void forget_wrenches();

  VectorXd turned(const VectorXd & v, double dt) const;
  VectorXd turning(const VectorXd & v) const;
  void rows_before(MatrixXd & J, const VectorXd & v) const;
  void integrate(const VectorXd & q, const VectorXd & along, VectorXd & moved);

  Scene scene_; // its own: contacts are anchored where each motion begins
  Mechanics mechanics_;
  Rows rows_;
  int rank_; // of J_b, at most
  StepPlan plan_{};
  std::vector<std::pair<int, int>> floating_; // where q and v hold the bodies that float
  VectorXd applied_, stiffness_, inertia_, still_;

  // the step from (at_, v0_)
  VectorXd at_, v0_, mean_, turning_, tau_, h_, slip_, gaps_;
  MatrixXd M_, L_, J_, J_b_;
  Blocked blocked_;
  VectorXd momentum_, held_, free_; // V^T (L^T v + L^-1 p), h, and L^T v_free
  Posed posed_;
  VectorXd ended_, ends_, moved_, gap_there_;
  MatrixXd J_there_, whitened_;
  Forces on_joint_;
  VectorXd torque_;
};
} // namespace condyn
