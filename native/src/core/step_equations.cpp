// The equations of a step with contacts, linearised: df, ds and e of `StepDerivatives`.
#include "step_derivatives.hpp"
#include <algorithm>

namespace condyn
{
/// The equations of a step to v1 whose h is that of a mean velocity.
void StepDerivatives::linearise(const VectorXd & mean, const VectorXd & v1, const VectorXd & l_b)
{
  const ContactSteps & step = steps_;
  const double dt = step.plan_.dt;
  const VectorXd a = (v1 - step.free_.v) / dt - step.floating_.turning(mean);
  if (scene_.rows)
    mechanics_.place(step.free_.q);
  linearisation_.at(step.free_.q, mean, a, l_b / dt, no_loads_, mechanics_.data);
}

/// Of the balance of momentum (nv, 2 nv): by q, and by the velocity of h. By the velocity before it is M more: what
/// springs and damping add to that, dt D + dt^2 K, they take from the torques. False where those between frames have no
/// slopes.
bool StepDerivatives::balance(const VectorXd & mean, const VectorXd & v1)
{
  const ContactSteps & step = steps_;
  const int n = scene_.model.nv;
  const double dt = step.plan_.dt;
  f_ = dt * linearisation_.r();
  f_.leftCols(n).diagonal() -= dt * step.free_.stiffness;
  moved_partials_.turning(mean).add_product(step.free_.M, dt, f_.rightCols(n));
  springs_.at(linearisation_.data);
  return springs_.add_slopes(v1, dt, linearisation_.data, f_.leftCols(n));
}

/// Of the constraints (rows, 2 nv), linearised at the velocity before: J_b (2 v+ / dt - w x u) + gamma = 0.
MatrixXd StepDerivatives::slip(const VectorXd & v1)
{
  const ContactSteps & step = steps_;
  const int n = scene_.model.nv, m = scene_.rows;
  const double dt = step.plan_.dt;
  if (!m)
    return MatrixXd(0, 2 * n);
  MatrixXd s = linearisation_.s();
  moved_partials_.turning(step.free_.v).add_product(linearisation_.J, 1.0, s.rightCols(n));
  s.leftCols(n) -= linearisation_.turning((v1 + step.free_.v) / dt);
  return 0.5 * dt * s;
}

/// Of the contacts that take part (m, 2 nv): J_c v+ as the rows turn, and what gaps and bends ask for.
void StepDerivatives::ask()
{
  const ContactSteps & step = steps_;
  const auto & posed = step.touching_;
  const int n = scene_.model.nv, cones = posed.problem.cones();
  const double dt = step.plan_.dt;
  e_.setZero(posed.problem.rows(), 2 * n);
  for (int i = 0; i < posed.with_gaps; ++i)
  {
    const int row = posed.problem.normal(i);
    const double gap = posed.gaps[i];
    const double pushed = posed.allowed[i] == step.plan_.pushed_out * gap ? step.plan_.pushed_out : 0.0;
    const double share = gap < -step.plan_.at_rest ? pushed : 1.0;
    e_.row(row).head(n) = share / dt * posed.J_c.row(row);
  }
  if (!cones)
    return;
  e_.topLeftCorner(3 * cones, n) += after_;
  turn_towards_end();
}

/// Adds to e how normals of planes bend: their gaps are those at the end of a step along v.
void StepDerivatives::turn_towards_end()
{
  const ContactSteps & step = steps_;
  const auto & posed = step.touching_;
  const int n = scene_.model.nv;
  const auto begin = posed.chosen.begin(), end = begin + posed.problem.cones();
  const int over_planes = int(std::lower_bound(begin, end, step.candidates.over_planes()) - begin);
  if (!over_planes)
    return;
  const double dt = step.plan_.dt;
  VectorXd there = step.q;
  step.floating_.integrate(mechanics_, step.free_.q, dt * step.free_.v, there);
  mechanics_.jacobians(there);
  MatrixXd ends(over_planes, n);
  for (int i = 0; i < over_planes; ++i)
    step.candidates.normal_row(posed.chosen[i], mechanics_.data, ends.row(i));
  MatrixXd by_start = ends, by_move = ends;
  moved_partials_.by_start(dt * step.free_.v).postmultiply(by_start);
  moved_partials_.by_move(dt * step.free_.v).postmultiply(by_move);
  for (int i = 0; i < over_planes; ++i)
  {
    const int row = 3 * i + 2;
    e_.row(row).head(n) += (by_start.row(i) - posed.J_c.row(row)) / dt - before_.row(row);
    e_.row(row).tail(n) += by_move.row(i) - posed.J_c.row(row);
  }
}
} // namespace condyn
