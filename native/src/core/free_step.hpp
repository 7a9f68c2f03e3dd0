// The step that a robot would take without contacts, and what its constraints block.
//
//   M + dt D + dt^2 K = S^T S,    V h the least S v with the J_b v that is asked for (`Blocked`)
//   S v_free = (1 - V V^T) (S v + S^-T p) + V h,    p = dt (tau - h(q, v)),    J_b v+ = s' - dt (gamma - s'') / 2
#pragma once
#include "blocked.hpp"
#include "floating.hpp"
#include "jacobian.hpp"
#include "rows.hpp"
#include "springs.hpp"
#include "step_plan.hpp"
#include "tree_factor.hpp"

namespace condyn
{
class FreeStep
{
public:
  /// `rank` of J_b, at most. All have to stay where they are.
  FreeStep(const Scene & scene, const Floating & floating, Mechanics & mechanics, Rows & rows, int rank);
  FreeStep(const FreeStep &) = delete;

  /// Gets ready for steps with torques applied (nv,).
  void begin(const StepPlan & plan, const VectorXd & applied);
  /// The step from a state, and joint Jacobians there; false where there is none.
  bool pose(const VectorXd & q, const VectorXd & v);
  /// With the velocity that h is taken at, besides the one of the state.
  void condense(const VectorXd & mean);
  /// With h at the mean velocity of the step, for what nothing touches.
  void condense_at_mean();
  /// X = (1 - V V^T) S^-T J^T and the part V^T S^-T J^T that is blocked; zero for a row that constraints hold, but
  /// for what is blocked of one that a path moves.
  void eliminate(const MatrixXd & J, MatrixXd & X, MatrixXd & along_blocked) const;
  /// The factors that a step at q would have; false where there are none.
  bool factorise_at(const VectorXd & q, TreeFactor & factor, Blocked & blocked);
  /// v from S v, in place.
  void unwhiten(VectorXd & v) const { factor_.unwhiten(v); }

  /// J_b where the step begins.
  const MatrixXd & J() const { return J_; }
  /// S of M + dt D + dt^2 K.
  const TreeFactor & factor() const { return factor_; }

  VectorXd q, v; // where it begins
  VectorXd mean, turning; // the velocity of h, and the acceleration that is only turning
  MatrixXd M; // without what springs and damping add
  VectorXd tau, h; // torques with those of springs and damping, and h(q, v)
  VectorXd stiffness, inertia; // K, and dt D + dt^2 K, which S^T S has on its diagonal
  SpringInertia of_springs; // dt D + dt^2 K of those between frames
  VectorXd free; // S v_free
  Blocked blocked;
  VectorXd momentum, held, path; // V^T (S v + S^-T p), h of V h, and the part of h that is of s'

private:
  bool factorise(const MatrixXd & M, const SpringInertia & springs, TreeFactor & factor) const;
  void block(const VectorXd & gamma);
  void whiten(MatrixXd rows, const TreeFactor & factor, Blocked & blocked) const;

  const Scene & scene_;
  const Floating & floating_;
  Mechanics & mechanics_;
  Rows & rows_;
  int rank_;
  std::vector<Moved> moved_; // of each constraint
  Springs springs_;
  StepPlan plan_{};
  VectorXd applied_, still_;
  TreeFactor factor_;
  MatrixXd J_;
};
} // namespace condyn
