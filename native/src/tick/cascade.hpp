// The levels of a hierarchy, each answered within what those above it leave.
//
//   min_s  w |G^T (x + Z s) - b|^2 + eps |x + Z s|^2,     lower <= C^T (x + Z s) <= upper
//
//   x <- x + Z s,    Z <- Z null(G^T Z, rows of C^T Z that are strictly active)
//
// with Z the null space of the equations at first. `condyn_pin/control/hierarchy.py` says more; whatever there hangs on
// a threshold that rounding may cross is left to it.
#pragma once
#include "active_set.hpp"
#include "null_space.hpp"
#include "tick_spec.hpp"
#include "wishes.hpp"

namespace condyn
{
using Sides = std::vector<Side>;

class Cascade
{
public:
  explicit Cascade(const TickSpec & spec);

  /// The largest KKT residual of all levels; it counts if that is below `kkt`. NaN or infinite where Python has to
  /// look. `sides` of each level are those to begin from, and then those of its answer.
  double solve(const QuadraticProgram & program, const Wishes & wishes, std::vector<Sides> & sides);

  VectorXd x; // the answer
  int changes = 0, answered = 0; // of the active sets; levels, of which those below may be left nothing

private:
  /// x with the equations, and what they leave; false where that is in doubt.
  bool begin(const QuadraticProgram & given);
  /// The program of a level over s.
  void write(const QuadraticProgram & given, const Wishes & wishes, int first, int size);
  /// Bounds as far as the levels above have left them; false where it is in doubt whether they have decided a row.
  bool leave_slack();
  /// Z of the levels below; false where it is in doubt. `G` are the rows of the tasks over x.
  bool narrow(const Eigen::Ref<const MatrixXd> & G, const ActiveSet & level);
  /// Appends which inequalities stay equations for the levels below; false where that is in doubt.
  bool strictly_active(const VectorXd & z, std::vector<int> & active) const;
  /// Leaves out rows of tasks that the levels above have decided: what rounding leaves of them has any direction. False
  /// where that is in doubt.
  bool drop_decided(const Eigen::Ref<const MatrixXd> & G);
  /// Whether rows at their bounds depend on each other: others may be active in the place of those that are.
  bool has_other_multipliers(const ActiveSet & level);

  const TickSpec & spec_;
  std::vector<ActiveSet> levels_;
  QuadraticProgram inner_;
  NullSpace null_;
  MatrixXd Z_, G_, kept_; // Z^T G of a level, and what those below have as equations
};
} // namespace condyn
