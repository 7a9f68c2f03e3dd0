// Steps of Stewart and Trinkle: velocities that close the gaps of a step, with Coulomb's law.
//
//   M (v+ - v) = dt (tau - h) + J_b^T l_b + J_c^T lam,    J_b v+ = s' - dt (gamma - s'') / 2
//   sigma = G lam + g,    g_n = J_n v_free + (s + gap) / dt  (gap > 0),  J_n v_free + (s + 0.2 gap) / dt  (gap < 0)
//   q+ = q (+) dt v+,     s = gap(q (+) dt v) - gap - dt J_n v
//
// `FreeStep` is the step without contacts, `ContactView` what it asks of those that take part.
// `condyn_pin/stepping/contact_steps.py` derives each. What it answers in another way than by a
// first attempt of its contact solver is left to it.
#pragma once
#include "chart.hpp"
#include "measures.hpp"
#include "touching.hpp"
#include <deque>

namespace condyn
{
class ContactSteps
{
public:
  ContactSteps(const Scene & scene, const Candidates & candidates, int rank);
  ContactSteps(const ContactSteps &) = delete; // it refers to its own scene

  /// Gets ready for steps with torques applied (nv,).
  void begin(const StepPlan & plan, const VectorXd & applied);
  /// Takes driven rows to where they are to be at the beginning of a step of a motion.
  void at(int step) { plan_.path.put(2 * step, scene_); }
  bool is_driven() const { return !plan_.path.rows.empty(); }
  /// Gives contacts of the scene without an anchor the place where they are at q.
  void anchor(const VectorXd & q);
  /// Whether loops and contacts at a state are clearly where a motion may begin.
  bool fits(const VectorXd & q, const VectorXd & v, double closed);
  /// Whether a body turns further in a step than one chart goes.
  bool turns_too_far(const VectorXd & v) const { return chart_.turns_too_far(v, plan_.dt); }
  /// Takes a step of a motion; false where Python has to say what becomes of it.
  bool attempt(const VectorXd & q, const VectorXd & v, int step = 0);

  // The last step.
  VectorXd q, v, a; // at its end, and the mean acceleration
  double natural = 0; // residual of the contact problem
  Eigen::Vector4d work; // of contacts, of corrections, what is algorithmic, and of drives: `ContactWork` of Python [J]
  VectorXd impulses(); // of constraints, then of all candidates [N s, N m s]
  Eigen::VectorXi modes() const; // of all candidates
  /// Natural residual, what is left of the balance of momentum [N s] and of J_b v+ [m/s], violation,
  /// penetration, energy lost, correction work and algorithmic work [J].
  void errors(double * eight);
  /// What is said of a sample, at a state.
  void measure(const VectorXd & q, const VectorXd & v, double * numbers);

  const Candidates & candidates;

private:
  friend class StepDerivatives; // of the step as it was posed and answered
  void pose();
  void pose_along(const VectorXd & u);
  bool solve();
  bool answer();
  double off();
  VectorXd begun() const;
  bool nearest();
  bool close_loops();
  bool follows();
  double drive_work();
  double energy(const VectorXd & q, const VectorXd & v);
  double momentum_left(const VectorXd & lam);
  double slip_left();
  void push_along_path(const VectorXd & of_contacts, VectorXd & tau);
  void forget_wrenches();

  const Scene & given_;
  Scene scene_; // its own: contacts are anchored where each motion begins, and driven rows move
  Mechanics mechanics_;
  Rows rows_;
  Floating floating_;
  Chart chart_;
  StepPlan plan_{};
  VectorXd still_;

  // the step from (free_.q, free_.v)
  int step_ = 0; // of the motion
  FreeStep free_;
  Touching touching_;
  VectorXd gaps_, gap_there_, ends_; // of all candidates at its beginning, and at the end of a path
  MatrixXd J_, J_there_; // rows of all candidates
  VectorXd moved_;
  /// A part of the way on which loops are closed, by the factors of a step from its beginning.
  struct Closing
  {
    TreeFactor factor;
    Blocked blocked;
    VectorXd begin, end;
  };
  std::deque<Closing> closings_; // memory
  int closings_made_ = 0; // of the last step, by other factors than its own
  Forces on_joint_;
  VectorXd torque_;
};
} // namespace condyn
