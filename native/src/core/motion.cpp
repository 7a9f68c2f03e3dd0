#include "motion.hpp"
#include "anchors.hpp"
#include "answers.hpp"
#include "measures.hpp"
#include <pinocchio/algorithm/jacobian.hpp>
#include <pinocchio/algorithm/joint-configuration.hpp>
#include <pinocchio/algorithm/kinematics.hpp>

namespace condyn
{
Mover::Mover(const Scene & scene)
: scene_(scene), solver_(solver_of(scene_)), data_(scene_.model), rows_(scene_.rows), chart_(scene_.model)
, springs_(scene_), q1_(scene_.model.nq), floating_(scene_.model)
{
  const Model & model = scene_.model;
  for (int i = 1; i < model.njoints; ++i)
    if (model.parents[i] == 0)
      roots_.push_back(model.idx_vs[i]);
  for (auto * x : {&tau_, &a_, &a_middle_, &middle_v_, &along_, &y_, &V_})
    x->setZero(model.nv);
  middle_q_.setZero(model.nq);
}

bool Mover::run(
  const MotionPlan & plan, VectorXd & q, VectorXd & v, const VectorXd & tau, const Samples & samples,
  const std::atomic<bool> & stop)
{
  plan_ = plan, samples_ = samples, applied_ = tau;
  if (!begin(q, v))
    return false;
  int row = 0;
  double t = 0;
  for (int k = 0; k < plan.steps; ++k)
  {
    now_ = 2 * k;
    if (stop || !plan.path.leads_on(k) || (k % plan.every == 0 && !sample(row++, t, q, v, false)))
      return false;
    if (chart_.turns_too_far(v, plan.dt) || !step(q, v) || chart_.turns_too_far(v, plan.dt))
      return false;
    known_ = false;
    at(now_ + 2);
    if (!follows(q, v))
      return false;
    if (plan.correct_every && (k + 1) % plan.correct_every == 0 && !correct(q, v))
      return false;
    t = (k + 1) * plan.dt;
  }
  return sample(row, t, q, v, true) && v.cwiseAbs().maxCoeff() < plan.lost;
}

/// Gets everything ready at a first state; false where it does not satisfy the constraints clearly.
bool Mover::begin(VectorXd & q, VectorXd & v)
{
  const Passive & passive = scene_.passive;
  const bool semi = plan_.integrator == Integrator::semi_implicit;
  ahead_ = semi ? plan_.dt : plan_.dt / 2;
  inertia_ = ahead_ * passive.d;
  VectorXd stiffness = VectorXd::Zero(passive.d.size());
  for (Eigen::Index s = 0; s < passive.k.size(); ++s)
    stiffness[passive.at_v[s]] += passive.k[s];
  inertia_ += ahead_ * ahead_ * stiffness;
  heavy_ = scene_.model.armature + inertia_;
  const bool anything = passive.d.any() || passive.k.any() || !springs_.none();
  first_ = semi && anything ? Inertia::heavy : Inertia::plain;
  drag_ = semi && anything ? plan_.dt : 0.0;
  known_ = begun_ = false;
  a_middle_.setZero();
  if (!scene_.unanchored.empty())
    pinocchio::forwardKinematics(scene_.model, data_, q);
  anchor(scene_, data_);
  solver_->begin(plan_.rank);
  at(0);
  pinocchio::forwardKinematics(scene_.model, data_, q, v, a_middle_);
  rows_.evaluate(scene_, data_, q, v, a_middle_);
  return std::max(largest(rows_.c), largest(rows_.velocity)) < plan_.closed;
}

/// Takes driven rows to where they are to be after so many half steps.
void Mover::at(int halves)
{
  plan_.path.put(halves, scene_);
}

/// Whether the loops go where driven rows lead them.
bool Mover::follows(const VectorXd & q, const VectorXd & v)
{
  if (plan_.path.rows.empty())
    return true;
  pinocchio::forwardKinematics(scene_.model, data_, q, v);
  rows_.evaluate(scene_, data_, q, v, v);
  return largest(rows_.c) <= plan_.out_of_reach;
}

/// Looks at the springs between frames.
void Mover::look(const VectorXd & q)
{
  if (springs_.none())
    return;
  pinocchio::computeJointJacobians(scene_.model, data_, q);
  springs_.at(data_);
  of_springs_ = springs_.inertia(ahead_);
}

/// The torques applied with those of springs and damping: -(d + drag k) v - k (q - rest), and between frames.
void Mover::torque(const VectorXd & q, const VectorXd & v, double drag)
{
  const Passive & passive = scene_.passive;
  VectorXd & pull = along_;
  pull = passive.d;
  if (drag != 0)
  {
    VectorXd & stiffness = tau_;
    stiffness.setZero();
    for (Eigen::Index s = 0; s < passive.k.size(); ++s)
      stiffness[passive.at_v[s]] += passive.k[s];
    pull += drag * stiffness;
  }
  pull = pull.cwiseProduct(v).eval();
  for (Eigen::Index s = 0; s < passive.k.size(); ++s)
    pull[passive.at_v[s]] += passive.k[s] * (q[passive.at_q[s]] - passive.rest[s]);
  tau_ = applied_ - pull;
  look(q);
  springs_.pull(v, drag, tau_);
  if (drag != 0 && !floating_.none()) // what acts ahead acts on a + w x u
  {
    const VectorXd turning = floating_.turning(v);
    tau_ -= inertia_.cwiseProduct(turning);
    if (!springs_.none())
      tau_ -= of_springs_ * turning;
  }
}

void Mover::weigh(Inertia inertia)
{
  solver_->model.armature = inertia == Inertia::heavy ? heavy_ : scene_.model.armature;
  if (!springs_.none())
    solver_->springs = inertia == Inertia::heavy ? of_springs_ : SpringInertia();
}

bool Mover::solve(const VectorXd & q, const VectorXd & v, VectorXd & a, Inertia inertia)
{
  weigh(inertia);
  a = solver_->acceleration(q, v, tau_);
  for (int i : roots_) // what is not finite anywhere is not finite there
    if (!(std::abs(a[i]) < plan_.largest))
      return false;
  return true;
}

bool Mover::acceleration(const VectorXd & q, const VectorXd & v, VectorXd & a, double drag, Inertia inertia)
{
  torque(q, v, drag);
  return solve(q, v, a, inertia);
}

void Mover::move(VectorXd & q, const VectorXd & along)
{
  pinocchio::integrate(scene_.model, q, along, q1_);
  q.swap(q1_);
}

/// The place and the velocity of coordinates of a step from q.
void Mover::go(const VectorXd & q, const VectorXd & y, const VectorXd & V, VectorXd & q1, VectorXd & v1) const
{
  pinocchio::integrate(scene_.model, q, y, q1);
  floating_.straighten(q, y, q1);
  v1 = floating_.own(y, V);
}

/// One Newton step back to the constraints; the acceleration of the look counts for what it leads to.
bool Mover::correct(VectorXd & q, VectorXd & v)
{
  known_ = solver_->closes_by_its_factor();
  if (known_ && !acceleration(q, v, a_, drag_, first_))
    return false;
  look(q);
  weigh(first_); // the last solve may have been that of a step's middle
  if (!solver_->close(q, v, dq_, dv_))
    return false;
  move(q, dq_);
  v += dv_;
  return true;
}

/// Keeps a state; the last one has the answer without what acts ahead.
bool Mover::sample(int row, double t, const VectorXd & q, const VectorXd & v, bool last)
{
  const Model & model = scene_.model;
  const bool known = known_ && !(last && first_ == Inertia::heavy);
  if (!known && (plan_.with_answers || last))
  {
    if (!acceleration(q, v, a_, last ? 0.0 : drag_, last ? Inertia::plain : first_))
      return false;
    known_ = !last;
  }
  samples_.t[row] = t;
  Out(samples_.q + std::size_t(row) * model.nq, model.nq) = q;
  Out(samples_.v + std::size_t(row) * model.nv, model.nv) = v;
  if (plan_.with_answers)
  {
    Out(samples_.a + std::size_t(row) * model.nv, model.nv) = a_;
    Out(samples_.lam + std::size_t(row) * scene_.rows, scene_.rows) = solver_->scene_forces();
  }
  pinocchio::forwardKinematics(model, data_, q, v);
  rows_.evaluate(scene_, data_, q, v, v);
  write_measures(scene_, data_, rows_, q, v, samples_.measures + measured * std::size_t(row));
  return true;
}
} // namespace condyn
