// The contacts that take part in a step, and what it asks of their impulses.
//
//   X = (1 - V V^T) S^-T J_c^T,    G = X^T X,    g = X^T S v_free + (V^T S^-T J_c^T)^T h
//   g_n += (s + gap) / dt  (gap > 0),    s / dt - p,  p = min(-0.2 gap / dt, 0.2 m/s), or what can follow  (gap < 0)
//
// s is how much a gap bends away from the straight line along which its row would take it.
#pragma once
#include "candidates.hpp"
#include "contact_problem.hpp"
#include "free_step.hpp"

namespace condyn
{
using Flags = std::vector<char>; // of all candidates

struct Touching
{
  Flags active;
  std::vector<int> chosen; // the candidates that are active
  int with_gaps = 0; // how many of the chosen have a gap
  bool along_path = false; // whether contacts are taken where a path ends
  VectorXd path; // the velocity along it
  MatrixXd J_c, X, blocked; // rows, and S^-T J_c^T along what is free and what is blocked
  VectorXd gaps, bends, before; // of what has a gap, and J_c v
  VectorXd allowed; // how far gaps may close in the step; negative for what is pushed out [m, rad]
  ContactProblem problem;
  VectorXd lam, v1; // the answer, and the velocity after it

  void choose(const Flags & active, const Candidates & candidates, const StepPlan & plan);
  /// Takes the rows of the chosen from those of all, and eliminates the constraints.
  void eliminate(const MatrixXd & all, const Candidates & candidates, const FreeStep & free);
  /// G and g of gaps and bends of the chosen that have them.
  void ask(const VectorXd & gaps, const VectorXd & bends, const FreeStep & free, const StepPlan & plan);
  /// Whether a gap is pushed out by less than that share of what it would be alone: nothing can follow.
  bool is_pressed(int with_gap, const StepPlan & plan, double share = 0.99) const;
  /// Whether gaps and shapes contradict each other, of which Python has a notice.
  bool contradicts(const StepPlan & plan) const;
  /// Takes no impulse for what constraints hold, where any would meet the law.
  void forget_held();
  /// What friction and impacts took, what pushing out gave, and what impulses gave against the laws of contact.
  Vector3d work(const StepPlan & plan) const;

private:
  void yield(const StepPlan & plan);
  void follow(const std::vector<int> & island, double dt);
};
} // namespace condyn
