// Verdict: whether an answer is ok without a doubt, by the sizes of its residuals.
//
//   |e_i| <= w_max e_M + the error by directions,    e_M = sum_j w_j |r_j| + sqrt(m) |s|_inf / sigma
//
// `ErrorEstimator.prove` in `condyn_pin/dynamics/residuals.py` is the same, and says why; the numbers come from there.
#pragma once
#include "pinocchio.hpp"
#include <cmath>
#include <limits>

namespace condyn
{
/// The largest of each, and what r is worth: `Equations.errors` in Python.
struct Sizes
{
  double dynamics, a, violation, velocity, constraint, lam, weighted;
  double lean; // error of directions that are computed, over eps
  double changes; // share of a that closing the loops changes, of a state off its constraints
};

struct Verdict
{
  double gravity, largest_weight, per_row, rounding; // what makes an error of residuals
  double leaning, leaning_forces; // and of directions that are off, with a and with lam
  // beyond which there is a doubt:
  double negligible_constraint_error, plausible_acceleration, plausible_force, negligible_dynamics_error;
  double solved, loose, fastest; // of any scene: SOLVED, how far quaternions are off, a that is no machine's

  /// A bound on the error of a, relative to the larger of |a|_inf and gravity.
  double bound(const Sizes & s) const
  {
    const double scale = scale_of(s), infinite = std::numeric_limits<double>::infinity();
    const double error = largest_weight * (s.weighted + per_row * s.constraint);
    return (scale > 0 ? error / scale : error <= 0 ? 0.0 : infinite) + rounding + lean(s);
  }

  /// What is not a number is in doubt. `pivots` is what is left of those of M.
  bool is_clear(const Sizes & s, double bound, double pivots, double accuracy) const
  {
    const double scale = scale_of(s);
    return !(s.constraint > negligible_constraint_error * scale) // which may be infinite
           && s.a <= plausible_acceleration && s.a < fastest && s.lam <= plausible_force * scale
           && s.dynamics <= negligible_dynamics_error * scale
           && lean(s) <= solved / 1000 // NaN is in doubt
           && bound <= std::min(solved, accuracy) && bound <= solved * pivots;
  }

  /// Whether no proof need look at the quaternions of q.
  bool is_normalised(const Model & model, const VectorXd & q) const
  {
    for (int i = 1; i < model.njoints; ++i)
      if (model.nqs[i] > model.nvs[i]) // it ends with one
        if (!(std::abs(q.segment<4>(model.idx_qs[i] + model.nqs[i] - 4).norm() - 1.0) <= loose))
          return false;
    return true;
  }

private:
  /// Error of a by that of directions, relative.
  double lean(const Sizes & s) const
  {
    return s.lean == 0 ? 0.0 : s.lean * (leaning + leaning_forces * s.lam / scale_of(s));
  }
  double scale_of(const Sizes & s) const { return std::max(s.a, gravity); } // NaN where a is
};
} // namespace condyn
