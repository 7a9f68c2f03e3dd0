// Motions: steps of an integrator, the correction of a drift scheme behind each, and samples.
//
//   semi-implicit Euler    v1 = v + h a(q, v),    q1 = q (+) h v1
//   midpoint               a_m at (q (+) h/2 v_m, v_m), v_m = v + h/2 a_m;    v1 = v + h a_m
//     linearly implicit      one iteration that begins with the a_m of the step before
//     implicit               iterations to the last digit
//   Runge-Kutta 4          the four stages of the classic method
//
// All are in the coordinates of a step, where bodies that float go straight (`Floating`, `Chart`).
//
// Springs and damping at the end of a step are inertia, h D + h^2 K (`condyn_pin/simulation/system.py`); of those
// between frames that is a matrix, which the solver is handed.
// One Newton step back to the constraints, the least in the metric of M:
//
//   q (+) dq,    v + dv,    [dq, dv] = -M^-1 J^T G^+ [c, J v]
//
// Driven rows are where their paths are at the time of each look at them (`Path`).
//
// A motion that cannot go on is given up: Python makes it again, and says why.
#pragma once
#include "chart.hpp"
#include "floating.hpp"
#include "path.hpp"
#include "rows.hpp"
#include "solver.hpp"
#include <atomic>
#include <memory>

namespace condyn
{
enum class Integrator { semi_implicit, explicit_forces, linear_midpoint, implicit_midpoint, runge_kutta_4 };

struct MotionPlan
{
  Integrator integrator;
  double dt; // [s]
  int steps, every; // which sample is kept
  int correct_every; // 0: never
  bool with_answers; // whether a and lam of samples are asked for
  double closed; // gap [m, rad] and slip at the start that are closed without a doubt
  double largest; // acceleration, and
  double lost; // velocity of no machine [rad/s, m/s]
  double reach; // how far joints may be from the world's origin, all shifts at zero [m]
  int rank; // of the rows, at configurations that are not singular by accident
  double out_of_reach; // gap behind a step at which loops do not follow a path [m, rad]
  Path path; // of driven rows
};

/// Where a motion writes its samples, a row each.
struct Samples
{
  double *t, *q, *v, *a, *lam; // a and lam may be null
  double * measures; // of each, as `write_measures` has them
};

/// One thread's memory for motions of a scene.
class Mover
{
public:
  explicit Mover(const Scene & scene);
  Mover(const Mover &) = delete; // its solver refers to its scene

  /// Moves q and v to their end; false where Python has to say why that cannot be.
  bool run(
    const MotionPlan & plan, VectorXd & q, VectorXd & v, const VectorXd & tau, const Samples & samples,
    const std::atomic<bool> & stop);

private:
  enum class Inertia { plain, heavy };

  bool begin(VectorXd & q, VectorXd & v);
  void at(int halves);
  bool follows(const VectorXd & q, const VectorXd & v);
  bool step(VectorXd & q, VectorXd & v);
  bool improve(const VectorXd & q, const VectorXd & v);
  bool iterate(const VectorXd & q, const VectorXd & v);
  bool runge_kutta(VectorXd & q, VectorXd & v);
  bool correct(VectorXd & q, VectorXd & v);
  bool sample(int row, double t, const VectorXd & q, const VectorXd & v, bool last);

  bool acceleration(const VectorXd & q, const VectorXd & v, VectorXd & a, double drag, Inertia inertia);
  void weigh(Inertia inertia);
  bool solve(const VectorXd & q, const VectorXd & v, VectorXd & a, Inertia inertia);
  void look(const VectorXd & q);
  void torque(const VectorXd & q, const VectorXd & v, double drag);
  void move(VectorXd & q, const VectorXd & along);
  void go(const VectorXd & q, const VectorXd & y, const VectorXd & V, VectorXd & q1, VectorXd & v1) const;

  Scene scene_; // its own: contacts are anchored where each motion begins
  std::unique_ptr<Solver> solver_;
  Data data_;
  Rows rows_;
  Chart chart_;
  Springs springs_;
  SpringInertia of_springs_; // where they were looked at last
  std::vector<int> roots_; // where v begins for each joint on the world

  MotionPlan plan_;
  Samples samples_;
  VectorXd dq_, dv_, applied_, tau_, heavy_, inertia_, a_, a_middle_, middle_q_, middle_v_, along_, q1_;
  double ahead_ = 0; // of what is inertia [s]
  double drag_ = 0; // what springs ahead add to the damping [s]
  Inertia first_ = Inertia::plain; // of the solve that a step begins with
  int now_ = 0; // half steps behind which a step begins
  bool known_ = false; // whether a_ is that of the state already
  bool begun_ = false; // whether a_middle_ is that of a step

  Floating floating_;
  VectorXd y_, V_; // coordinates and velocities of a step; a_middle_ is V' in the axes of its start
};
} // namespace condyn
