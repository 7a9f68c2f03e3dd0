// How steps with contacts are taken, as Python says it; its file `stepping/batch.py` names
// where each number comes from.
#pragma once
#include "contact_solve.hpp"
#include "path.hpp"
#include <algorithm>

namespace condyn
{
struct StepPlan
{
  double dt; // [s]
  ContactMethod method; // that finds the impulses
  double near, pushed_out, pushes, at_rest, touches; // of gaps [m, rad]; share of a penetration, and its speed [m/s]
  double solved, moves; // natural residual, and what slides faster than that share of |g|
  double straight, missed; // where paths are looked at, and how far from where they should they may end [m, rad]
  double closed, small; // gaps of loops: left, and closed by the factors of the step [m, rad]
  double rank_tolerance; // of J_b L^-T
  double deep; // a penetration at the start that is none without a doubt [m, rad]
  double not_driven; // rates of contact rows that constraints hold, and that no path moves [m/s, rad/s]
  double out_of_reach; // gap behind a step at which loops do not follow a path [m, rad]
  Path path; // of driven rows

  /// How far a contact with this gap may close in a step; negative for what is pushed out [m, rad].
  double allowed(double gap) const
  {
    return gap > touches ? gap : gap < -at_rest ? std::max(pushed_out * gap, -pushes * dt) : 0.0;
  }
};
} // namespace condyn
