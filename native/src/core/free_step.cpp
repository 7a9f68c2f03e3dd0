#include "free_step.hpp"
#include <cmath>

namespace condyn
{
namespace
{
constexpr double held_share = 1e-22; // as `_HELD`
} // namespace

FreeStep::FreeStep(const Scene & scene, const Floating & floating, Mechanics & mechanics, Rows & rows, int rank)
: scene_(scene), floating_(floating), mechanics_(mechanics), rows_(rows), rank_(rank)
, springs_(scene), still_(VectorXd::Zero(scene.model.nv)), factor_(scene.model, ties(scene))
{
  for (const auto & k : scene.constraints)
    moved_.emplace_back(scene.model, k);
}

void FreeStep::begin(const StepPlan & plan, const VectorXd & applied)
{
  plan_ = plan, applied_ = applied;
  const Passive & passive = scene_.passive;
  stiffness.setZero(scene_.model.nv);
  for (Eigen::Index s = 0; s < passive.k.size(); ++s)
    stiffness[passive.at_v[s]] += passive.k[s];
  inertia = plan.dt * passive.d + plan.dt * plan.dt * stiffness;
}

bool FreeStep::factorise(const MatrixXd & M, const SpringInertia & springs, TreeFactor & factor) const
{
  return springs.w.size() ? factor.factorise(M + springs.matrix(), inertia) : factor.factorise(M, inertia);
}

bool FreeStep::pose(const VectorXd & q0, const VectorXd & v0)
{
  const Passive & passive = scene_.passive;
  q = q0, v = v0;
  tau = applied_ - (passive.d + plan_.dt * stiffness).cwiseProduct(v);
  for (Eigen::Index s = 0; s < passive.k.size(); ++s)
    tau[passive.at_v[s]] -= passive.k[s] * (q[passive.at_q[s]] - passive.rest[s]);
  mechanics_.mass(q, M);
  springs_.at(mechanics_.data);
  springs_.pull(v, plan_.dt, tau);
  of_springs = springs_.inertia(plan_.dt);
  if (!factorise(M, of_springs, factor_))
    return false;
  h = mechanics_.bias(q, v);
  blocked.rank = 0;
  if (scene_.rows)
  {
    mechanics_.move(q, v, still_);
    rows_.evaluate(scene_, mechanics_.data, q, v, still_);
  }
  if (scene_.rows)
    block(rows_.acceleration);
  if (blocked.rank > rank_)
    return false;
  condense(v);
  return true;
}

void FreeStep::whiten(MatrixXd rows, const TreeFactor & factor, Blocked & of) const
{
  factor.whiten_rows(rows);
  of.compute(rows.transpose(), plan_.rank_tolerance);
}

bool FreeStep::factorise_at(const VectorXd & there, TreeFactor & factor, Blocked & of)
{
  MatrixXd inertias, rows;
  mechanics_.mass(there, inertias);
  springs_.at(mechanics_.data);
  if (!factorise(inertias, springs_.inertia(plan_.dt), factor))
    return false;
  mechanics_.jacobians(there);
  write_jacobian(scene_, mechanics_.data, moved_, rows);
  whiten(std::move(rows), factor, of);
  return of.rank <= rank_;
}

void FreeStep::block(const VectorXd & gamma)
{
  write_jacobian(scene_, mechanics_.data, moved_, J_);
  whiten(J_, factor_, blocked);
  held = blocked.held(-0.5 * plan_.dt * (gamma - J_ * floating_.turning(v)));
  if (!scene_.wanted.size())
    return;
  path = blocked.held(scene_.wanted.col(1));
  held += path;
}

void FreeStep::condense(const VectorXd & of_h)
{
  mean = of_h, turning = floating_.turning(mean);
  free = plan_.dt * (tau - h + M * turning);
  factor_.whiten(free);
  free += factor_ * v;
  if (!blocked.rank)
    return;
  momentum = blocked.V.transpose() * free;
  free += blocked.V * (held - momentum);
}

void FreeStep::condense_at_mean()
{
  VectorXd alone = free;
  unwhiten(alone);
  const VectorXd between = 0.5 * (v + alone), before = h;
  h = mechanics_.bias(q, between);
  condense(between);
  h = before;
}

void FreeStep::eliminate(const MatrixXd & J, MatrixXd & X, MatrixXd & along_blocked) const
{
  MatrixXd rows = J;
  factor_.whiten_rows(rows);
  X = rows.transpose();
  if (!blocked.rank)
    return;
  along_blocked = blocked.V.transpose() * X;
  X.noalias() -= blocked.V * along_blocked;
  // a row that constraints hold is theirs alone: what is left of it is rounding
  for (int i = 0; i < X.cols(); ++i)
  {
    if (!(X.col(i).squaredNorm() <= held_share * along_blocked.col(i).squaredNorm()))
      continue;
    X.col(i).setZero();
    if (!path.size() || std::abs(path.dot(along_blocked.col(i))) <= plan_.not_driven)
      along_blocked.col(i).setZero();
  }
}
} // namespace condyn
