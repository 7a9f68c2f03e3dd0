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
, turning_(scene_.model, steps.candidates), no_loads_(scene_.model, {}), springs_(scene_)
, carried_(scene_.model)
{
  for (const auto & k : scene_.constraints)
  {
    moved_.emplace_back(scene_.model, k);
    carried_.tie(moved_.back().columns);
  }
  for (int i = 0; i < steps.candidates.cones(); ++i)
    carried_.tie(turning_.columns(i));
  for (const auto & columns : ties(scene_))
    carried_.tie(columns);
}

bool StepDerivatives::operator()(const Readings & readings)
{
  const ContactSteps & step = steps_;
  const int n = scene_.model.nv, cones = step.candidates.cones();
  if (step.touching_.along_path || !(step.natural <= readings.polished))
    return false;
  for (int i = 0; i < step.touching_.with_gaps; ++i)
    if (step.touching_.is_pressed(i, step.plan_)) // Python flags slopes of pushes that give way
      return false;
  project();
  dv.setZero(n, 3 * n + cones);
  law_.read(step.touching_.problem, step.touching_.lam, slides * readings.polished);
  if (!(step.touching_.lam.size() ? touched() : untouched()))
    return false;
  read_margin(readings.falls);
  move();
  return close(readings) && std::isfinite(dq.sum() + dv.sum()) && !std::isnan(margin);
}

/// P without contacts.
void StepDerivatives::project()
{
  const FreeStep & free = steps_.free_;
  free.factor().invert(inverse_);
  P_ = inverse_;
  Z_.resize(scene_.model.nv, 0);
  if (!free.blocked.rank)
    return;
  MatrixXd rows = free.blocked.V.transpose();
  free.factor().unwhiten_rows(rows);
  Z_ = rows.transpose();
  P_.noalias() -= Z_ * rows;
}

// ------------------------------------------------------------------------------------------------
// The velocity after the step.

bool StepDerivatives::touched()
{
  const ContactSteps & step = steps_;
  const auto & posed = step.touching_;
  const int n = scene_.model.nv, cones = posed.problem.cones();
  MatrixXd by_g, by_friction;
  if (!law_.linearise(posed.problem, by_g, by_friction))
    return false;
  linearise(step.free_.v, posed.v1, steps_.impulses().head(scene_.rows));
  if (!balance(step.free_.v, posed.v1))
    return false;
  f_.rightCols(n) += step.free_.M;
  if (cones)
  {
    if (!turning_.go(linearisation_.data, std::vector<int>(posed.chosen.begin(), posed.chosen.begin() + cones)))
      return false;
    turning_.slips(posed.v1, after_);
    turning_.slips(step.free_.v, before_);
    turning_.pulls(posed.lam, f_.leftCols(n));
  }
  ask();
  MatrixXd rows = posed.X.transpose();
  step.free_.factor().unwhiten_rows(rows);
  Y_ = rows.transpose();
  YR_.noalias() = Y_ * by_g;
  P_.noalias() += YR_ * rows;
  if (step.free_.blocked.rank)
    dv.leftCols(2 * n).noalias() = (Z_ + YR_ * posed.blocked.transpose()) * step.free_.blocked.held(slip(posed.v1));
  carried_.add_product(P_, f_, dv.leftCols(2 * n));
  for (int j = 0; j < 2 * n; ++j)
    if (!e_.col(j).isZero(0.0)) // coordinates that move no contact ask for nothing
      dv.col(j).noalias() += YR_ * e_.col(j);
  dv.middleCols(2 * n, n) = step.plan_.dt * P_;
  const MatrixXd by_mu = Y_ * by_friction;
  for (int i = 0; i < cones; ++i)
    dv.col(3 * n + posed.chosen[i]) = by_mu.col(i);
  return true;
}

/// M x - J_b^T y = f, J_b x = s, by x.
MatrixXd StepDerivatives::solved(const MatrixXd & f, const MatrixXd & s) const
{
  MatrixXd x = P_ * f;
  if (steps_.free_.blocked.rank)
    x.noalias() += Z_ * steps_.free_.blocked.held(s);
  return x;
}

/// Where nothing touches: h at the mean of v and of v+ with h at v.
bool StepDerivatives::untouched()
{
  ContactSteps & step = steps_;
  const int n = scene_.model.nv, m = scene_.rows;
  const double dt = step.plan_.dt;
  const VectorXd first = 2 * step.free_.mean - step.free_.v;
  VectorXd l_b(0);
  if (m)
  {
    VectorXd y = dt * (step.free_.tau - step.free_.h + step.free_.M * step.floating_.turning(step.free_.v));
    step.free_.factor().whiten(y);
    y += step.free_.factor() * step.free_.v;
    l_b = step.free_.blocked.impulses(step.free_.held - step.free_.blocked.V.transpose() * y);
  }
  linearise(step.free_.v, first, l_b);
  MatrixXd f(n, 3 * n), s = MatrixXd::Zero(m, 3 * n);
  if (!balance(step.free_.v, first))
    return false;
  f << f_, dt * MatrixXd::Identity(n, n);
  f.middleCols(n, n) += step.free_.M;
  s.leftCols(2 * n) = slip(first);
  const MatrixXd dfirst = solved(f, s);
  linearise(step.free_.mean, step.touching_.v1, step.impulses().head(m));
  if (!balance(step.free_.mean, step.touching_.v1))
    return false;
  const MatrixXd by_mean = 0.5 * f_.rightCols(n);
  f.leftCols(n) = f_.leftCols(n), f.middleCols(n, n) = step.free_.M + by_mean;
  f.noalias() += by_mean * dfirst;
  if (m) // rows with the first h, and this v+
    s.leftCols(n) -= linearisation_.turning(step.touching_.v1 - first);
  dv.leftCols(3 * n) = solved(f, s);
  return true;
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
  moved_partials_.by_start(dt * v1).add_to(dq.leftCols(n));
  moved_partials_.turned(v1, dt).premultiply(dv);
}

/// Loops are closed behind the step, by its own factors or by those of some places on the way.
bool StepDerivatives::close(const Readings & readings)
{
  ContactSteps & step = steps_;
  if (!step.free_.blocked.rank || readings.placed.empty())
    return true;
  if (!step.closings_made_)
  {
    VectorXd begin = step.q;
    step.floating_.integrate(mechanics_, step.free_.q, step.plan_.dt * step.touching_.v1, begin);
    return close(step.free_.factor(), step.free_.blocked, begin, step.q, true, readings.placed);
  }
  std::vector<const ContactSteps::Closing *> parts;
  for (int i = 0; i < step.closings_made_; ++i)
    if (step.closings_[i].end != step.closings_[i].begin)
      parts.push_back(&step.closings_[i]);
  for (const auto * part : parts)
    if (!close(part->factor, part->blocked, part->begin, part->end, false,
               part == parts.back() ? readings.placed : std::vector<int>()))
      return false;
  return !parts.empty(); // what did not move at all Python has to say
}

/// A move x = M^-1 J_b^T y, M and J_b those where the step or the move begins. At the end of the last one rows that
/// are placed have c = 0; others have J_b x = 0 there, and of a move that others follow J_b x = -c.
bool StepDerivatives::close(
  const TreeFactor & factor, const Blocked & blocked, const VectorXd & begin, const VectorXd & end, bool is_of_step,
  const std::vector<int> & placed)
{
  const ContactSteps & step = steps_;
  const int n = scene_.model.nv, columns = is_of_step ? n : int(dq.cols());
  const VectorXd & at = is_of_step ? step.free_.q : begin;
  const VectorXd x = mechanics_.difference(begin, end);
  const VectorXd y = blocked.impulses(blocked.V.transpose() * (factor * x));
  mechanics_.place(at);
  weightless_.kp = placed.empty() ? 1.0 : 0.0;
  of_moves_.at(at, VectorXd::Zero(n), x, y, no_loads_, mechanics_.data);
  MatrixXd by_start(n, n), by_x(n, n), inverse, Z;
  mechanics_.integrate_partials(begin, x, by_start, by_x);
  MatrixXd left = of_moves_.r().leftCols(n);
  if (!springs_.none()) // they are part of M, and turn: what x adds to their slopes
  {
    MatrixXd at_rest = MatrixXd::Zero(n, n);
    springs_.at(of_moves_.data);
    if (!springs_.add_slopes(VectorXd::Zero(n), step.plan_.dt, of_moves_.data, at_rest)
        || !springs_.add_slopes(x, step.plan_.dt, of_moves_.data, left))
      return false;
    left -= at_rest;
  }
  if (!is_of_step)
  {
    factor.invert(inverse);
    MatrixXd rows = blocked.V.transpose();
    factor.unwhiten_rows(rows);
    Z = rows.transpose();
  }
  const MatrixXd & along = is_of_step ? Z_ : Z;
  MatrixXd turned = (is_of_step ? inverse_ : inverse) * left;
  MatrixXd opened = MatrixXd::Zero(scene_.rows, dq.cols()), closed = of_moves_.J * along;
  opened.leftCols(n) = of_moves_.J * turned - of_moves_.s().leftCols(n);
  if (!is_of_step) // where that is moves, too
    opened = (opened.leftCols(n) * dq).eval(), turned = (turned * dq).eval();
  dq = (by_start * dq).eval();
  dq.leftCols(columns) += by_x * turned;
  const MatrixXd back = by_x * along;
  if (!placed.empty())
  {
    mechanics_.jacobians(end);
    MatrixXd J;
    write_jacobian(scene_, mechanics_.data, moved_, J);
    for (int row : placed)
      opened.row(row) = J.row(row) * dq, closed.row(row) = J.row(row) * back;
  }
  Eigen::CompleteOrthogonalDecomposition<MatrixXd> decomposed(closed.rows(), closed.cols());
  decomposed.setThreshold(step.plan_.rank_tolerance);
  decomposed.compute(closed);
  if (decomposed.rank() != blocked.rank)
    return false;
  dq -= back * decomposed.solve(opened);
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
      off = std::min(
        off, std::abs(step.gaps_[i] / step.plan_.dt + step.J_.row(step.candidates.normal(i)).dot(posed.v1)));
  margin = off / std::max(speed, falls);
  modes = Eigen::VectorXi::Zero(step.candidates.count());
  if (touches)
    modes(posed.chosen) = law_.modes;
}
} // namespace condyn
