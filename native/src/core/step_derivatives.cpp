#include "step_derivatives.hpp"
#include <cmath>

namespace condyn
{
namespace
{
constexpr double slides = 100; // so much more than the residual that modes are read at is a slip

Scene without_gravity(const Scene & scene)
{
  Scene other = scene;
  other.model.gravity.setZero();
  return other;
}
} // namespace

StepDerivatives::StepDerivatives(ContactSteps & steps)
: steps_(steps), scene_(steps.scene_), weightless_(without_gravity(scene_)), mechanics_(scene_.model)
, linearisation_(scene_), of_moves_(weightless_), moved_partials_(scene_.model)
, turning_(scene_.model, steps.candidates), no_loads_(scene_.model, {})
{
  for (const auto & k : scene_.constraints)
    moved_.emplace_back(scene_.model, k);
}

bool StepDerivatives::operator()(const Readings & readings)
{
  const ContactSteps & step = steps_;
  const int n = scene_.model.nv, cones = step.candidates.cones();
  if (step.touching_.along_path || !(step.natural <= readings.polished))
    return false;
  W_.setIdentity(n, n);
  step.free_.factor().triangularView<Eigen::Lower>().solveInPlace(W_);
  dv.setZero(n, 3 * n + cones);
  law_.read(step.touching_.problem, step.touching_.lam, slides * readings.polished);
  if (!step.touching_.lam.size())
    untouched();
  else if (!touched())
    return false;
  read_margin(readings.falls);
  move();
  return close(readings) && dq.allFinite() && dv.allFinite() && !std::isnan(margin);
}

// ------------------------------------------------------------------------------------------------
// What a step of q and v leaves of the equations.

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
/// springs and damping add to that, dt D + dt^2 K, they take from the torques.
MatrixXd StepDerivatives::balance(const VectorXd & mean) const
{
  const ContactSteps & step = steps_;
  const int n = scene_.model.nv;
  const double dt = step.plan_.dt;
  MatrixXd f = dt * linearisation_.rhs.topLeftCorner(n, 2 * n);
  f.leftCols(n).diagonal() -= dt * step.free_.stiffness;
  moved_partials_.turning(mean).add_product(dt * step.free_.M, f.rightCols(n));
  return f;
}

/// Of the constraints (rows, 2 nv), linearised at the velocity before: J_b (2 v+ / dt - w x u) + gamma = 0.
MatrixXd StepDerivatives::slip(const VectorXd & v1)
{
  const ContactSteps & step = steps_;
  const int n = scene_.model.nv, m = scene_.rows;
  const double dt = step.plan_.dt;
  if (!m)
    return MatrixXd(0, 2 * n);
  MatrixXd s = linearisation_.rhs.bottomLeftCorner(m, 2 * n);
  moved_partials_.turning(step.free_.v).add_product(linearisation_.J, s.rightCols(n));
  s.leftCols(n) -= linearisation_.turning(step.free_.q, (v1 + step.free_.v) / dt);
  return 0.5 * dt * s;
}

/// Of the contacts that take part (m, 2 nv): J_c v+ as the rows turn, and what gaps and bends ask for.
MatrixXd StepDerivatives::asked()
{
  const ContactSteps & step = steps_;
  const auto & posed = step.touching_;
  const int n = scene_.model.nv, cones = posed.problem.cones();
  const double dt = step.plan_.dt;
  MatrixXd e = MatrixXd::Zero(posed.problem.rows(), 2 * n);
  for (int i = 0; i < posed.with_gaps; ++i)
  {
    const int row = posed.problem.normal(i);
    const double gap = posed.gaps[i];
    const double share = gap < -step.plan_.at_rest ? step.plan_.pushed_out : 1.0;
    e.row(row).head(n) = share / dt * posed.J_c.row(row);
  }
  if (!cones)
    return e;
  e.topLeftCorner(3 * cones, n) += after_;
  VectorXd there = step.q;
  steps_.floating_.integrate(mechanics_, step.free_.q, dt * step.free_.v, there);
  mechanics_.jacobians(there);
  MatrixXd all, ends(cones, n);
  step.candidates.rows(mechanics_.data, all);
  for (int i = 0; i < cones; ++i)
    ends.row(i) = all.row(step.candidates.normal(posed.chosen[i]));
  MatrixXd by_start = ends, by_move = ends;
  moved_partials_.by_start(dt * step.free_.v).postmultiply(by_start);
  moved_partials_.by_move(dt * step.free_.v).postmultiply(by_move);
  for (int i = 0; i < cones; ++i)
  {
    const int row = 3 * i + 2;
    e.row(row).head(n) += (by_start.row(i) - posed.J_c.row(row)) / dt - before_.row(row);
    e.row(row).tail(n) += by_move.row(i) - posed.J_c.row(row);
  }
  return e;
}

// ------------------------------------------------------------------------------------------------
// The velocity after the step.

bool StepDerivatives::touched()
{
  ContactSteps & step = steps_;
  const auto & posed = step.touching_;
  const int n = scene_.model.nv, cones = posed.problem.cones();
  MatrixXd by_g, by_friction;
  if (!law_.linearise(posed.problem, by_g, by_friction))
    return false;
  linearise(step.free_.v, posed.v1, step.impulses().head(scene_.rows));
  MatrixXd f = balance(step.free_.v);
  f.rightCols(n) += step.free_.M;
  if (cones)
  {
    turning_.go(linearisation_.data, std::vector<int>(posed.chosen.begin(), posed.chosen.begin() + cones));
    turning_.slips(posed.v1, after_);
    turning_.slips(step.free_.v, before_);
    turning_.pulls(posed.lam, f.leftCols(n));
  }
  const MatrixXd e = asked(), s = slip(posed.v1);
  const MatrixXd XR = posed.X * by_g;
  MatrixXd free = W_;
  free.noalias() += XR * (posed.X.transpose() * W_);
  if (step.free_.blocked.rank)
  {
    const MatrixXd & V = step.free_.blocked.V;
    free.noalias() -= V * (V.transpose() * W_);
    const MatrixXd along = V + XR * posed.blocked.transpose();
    dv.leftCols(2 * n) = unwhitened(along * step.free_.blocked.held(s));
  }
  const MatrixXd P = unwhitened(free);
  dv.leftCols(2 * n).noalias() += P * f;
  dv.leftCols(2 * n).noalias() += unwhitened(XR) * e;
  dv.middleCols(2 * n, n) = step.plan_.dt * P;
  const MatrixXd by_mu = unwhitened(posed.X * by_friction);
  for (int i = 0; i < cones; ++i)
    dv.col(3 * n + posed.chosen[i]) = by_mu.col(i);
  return true;
}

/// M x - J_b^T y = f, J_b x = s, by x.
MatrixXd StepDerivatives::solved(const MatrixXd & f, const MatrixXd & s) const
{
  const ContactSteps & step = steps_;
  MatrixXd y = whitened(f);
  if (step.free_.blocked.rank)
    y += step.free_.blocked.V * (step.free_.blocked.held(s) - step.free_.blocked.V.transpose() * y);
  return unwhitened(y);
}

/// Where nothing touches: h at the mean of v and of v+ with h at v.
void StepDerivatives::untouched()
{
  ContactSteps & step = steps_;
  const int n = scene_.model.nv, m = scene_.rows;
  const double dt = step.plan_.dt;
  const VectorXd first = 2 * step.free_.mean - step.free_.v;
  VectorXd l_b(0);
  if (m)
  {
    const VectorXd p = dt * (step.free_.tau - step.free_.h + step.free_.M * step.floating_.turning(step.free_.v));
    const VectorXd y = step.free_.factor().transpose() * step.free_.v + whitened(p);
    l_b = step.free_.blocked.impulses(step.free_.held - step.free_.blocked.V.transpose() * y);
  }
  linearise(step.free_.v, first, l_b);
  MatrixXd f(n, 3 * n), s = MatrixXd::Zero(m, 3 * n);
  f << balance(step.free_.v), dt * MatrixXd::Identity(n, n);
  f.middleCols(n, n) += step.free_.M;
  s.leftCols(2 * n) = slip(first);
  const MatrixXd dfirst = solved(f, s);
  linearise(step.free_.mean, step.touching_.v1, step.impulses().head(m));
  const MatrixXd again = balance(step.free_.mean), by_mean = 0.5 * again.rightCols(n);
  f.leftCols(n) = again.leftCols(n), f.middleCols(n, n) = step.free_.M + by_mean;
  f.noalias() += by_mean * dfirst;
  if (m) // rows with the first h, and this v+
    s.leftCols(n) -= linearisation_.turning(step.free_.q, step.touching_.v1 - first);
  dv.leftCols(3 * n) = solved(f, s);
}

// ------------------------------------------------------------------------------------------------
// The end of the step.

/// q+ = at (+) dt v+, and v+ in the axes of there.
void StepDerivatives::move()
{
  const ContactSteps & step = steps_;
  const int n = scene_.model.nv;
  const double dt = step.plan_.dt;
  const VectorXd & v1 = step.touching_.v1;
  dq = dt * dv;
  moved_partials_.by_move(dt * v1).premultiply(dq);
  MatrixXd by_start = MatrixXd::Identity(n, n);
  moved_partials_.by_start(dt * v1).premultiply(by_start);
  dq.leftCols(n) += by_start;
  moved_partials_.turned(v1, dt).premultiply(dv);
}

/// Loops are closed behind the step, along M^-1 J_b^T. Of moves that others follow that leaves out squares of
/// gaps. What has no place is closed anywhere: the moves leave it where the step has led.
bool StepDerivatives::close(const Readings & readings)
{
  ContactSteps & step = steps_;
  const Blocked & blocked = step.free_.blocked;
  const int n = scene_.model.nv;
  if (!blocked.rank || readings.placed.empty())
    return true;
  VectorXd begin = step.q;
  steps_.floating_.integrate(mechanics_, step.free_.q, step.plan_.dt * step.touching_.v1, begin);
  const VectorXd x = mechanics_.difference(begin, step.q);
  const VectorXd y = blocked.impulses(blocked.V.transpose() * (step.free_.factor().transpose() * x));
  mechanics_.place(step.free_.q);
  of_moves_.at(step.free_.q, VectorXd::Zero(n), x, y, no_loads_, mechanics_.data);
  MatrixXd by_start(n, n), by_x(n, n);
  mechanics_.integrate_partials(begin, x, by_start, by_x);
  dq = (by_start * dq).eval();
  dq.leftCols(n) += by_x * unwhitened(whitened(of_moves_.rhs.topLeftCorner(n, n)));
  mechanics_.jacobians(step.q);
  MatrixXd J;
  write_jacobian(scene_, mechanics_.data, moved_, J);
  const MatrixXd Z = by_x * unwhitened(blocked.V);
  MatrixXd opened = MatrixXd::Zero(J.rows(), dq.cols());
  for (int row : readings.placed)
    opened.row(row) = J.row(row) * dq;
  Eigen::CompleteOrthogonalDecomposition<MatrixXd> factor(J.rows(), Z.cols());
  factor.setThreshold(step.plan_.rank_tolerance);
  factor.compute(J * Z);
  if (factor.rank() != blocked.rank)
    return false;
  dq -= Z * factor.solve(opened);
  return true;
}

/// How far the step is from other modes: of what takes no part, the gap / dt by which it misses.
void StepDerivatives::read_margin(double falls)
{
  const ContactSteps & step = steps_;
  const auto & posed = step.touching_;
  const bool touches = posed.problem.rows() > 0;
  const double speed = touches ? Scale(posed.problem).speed : 0.0;
  double off = touches ? law_.margin(posed.problem) * speed : INFINITY;
  for (int i = 0; i < step.candidates.with_gaps(); ++i)
    if (!posed.active[i])
      off = std::min(off, std::abs(step.gaps_[i] / step.plan_.dt + step.J_.row(step.candidates.normal(i)).dot(posed.v1)));
  margin = off / std::max(speed, falls);
  modes = Eigen::VectorXi::Zero(step.candidates.count());
  if (touches)
    modes(posed.chosen) = law_.modes;
}
} // namespace condyn
