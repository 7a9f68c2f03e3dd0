// What there is to say of the last step with contacts.
#include "contact_steps.hpp"
#include <cmath>

namespace condyn
{
double ContactSteps::energy(const VectorXd & q, const VectorXd & v)
{
  double numbers[measured];
  measure(q, v, numbers);
  return numbers[2] + numbers[3] + numbers[4];
}

VectorXd ContactSteps::impulses()
{
  VectorXd all = VectorXd::Zero(scene_.rows + candidates.rows());
  if (free_.blocked.rank)
  {
    VectorXd missing = free_.held - free_.momentum;
    if (touching_.lam.size())
      missing -= touching_.blocked * touching_.lam;
    all.head(scene_.rows) = free_.blocked.impulses(missing);
  }
  int row = 0;
  for (int i : touching_.chosen)
  {
    all.segment(scene_.rows + candidates.first(i), candidates.size(i))
      = touching_.lam.segment(row, candidates.size(i));
    row += candidates.size(i);
  }
  return all;
}

Eigen::VectorXi ContactSteps::modes() const
{
  Eigen::VectorXi all = Eigen::VectorXi::Zero(candidates.count());
  if (touching_.lam.size())
    all(touching_.chosen) = contact_modes(touching_.problem, touching_.lam, plan_.moves);
  return all;
}

void ContactSteps::forget_wrenches()
{
  for (auto & f : on_joint_)
    f.setZero();
  torque_.setZero(scene_.model.nv);
}

/// Adds to tau what contacts do where the path ends, in the axes of its beginning.
void ContactSteps::push_along_path(const VectorXd & of_contacts, VectorXd & tau)
{
  floating_.integrate(mechanics_, free_.q, plan_.dt * touching_.path, ends_);
  mechanics_.place(ends_);
  forget_wrenches();
  candidates.push(mechanics_.data, of_contacts, on_joint_, torque_);
  const VectorXd held = mechanics_.inverse_dynamics(ends_, still_, still_, on_joint_);
  for (auto & f : on_joint_)
    f.setZero();
  MatrixXd pushed = (mechanics_.inverse_dynamics(ends_, still_, still_, on_joint_) - held).transpose();
  floating_.rows_before(pushed, touching_.path, plan_.dt);
  tau += torque_ + pushed.transpose();
}

/// What is left of the balance of momentum, by Newton and Euler [N s].
double ContactSteps::momentum_left(const VectorXd & lam)
{
  const VectorXd of_contacts = lam.tail(candidates.rows());
  const VectorXd gained = (touching_.v1 - free_.v) / plan_.dt;
  VectorXd tau = free_.tau - free_.inertia.cwiseProduct(gained) - free_.of_springs * gained;
  if (touching_.along_path)
    push_along_path(of_contacts, tau);
  mechanics_.move(free_.q, free_.mean, still_);
  forget_wrenches();
  if (!touching_.along_path)
    candidates.push(mechanics_.data, of_contacts, on_joint_, torque_);
  add_wrenches(scene_, mechanics_.data, lam.head(scene_.rows), on_joint_, torque_);
  const VectorXd left = mechanics_.inverse_dynamics(free_.q, free_.mean, a, on_joint_) - tau - torque_;
  return plan_.dt * largest(left);
}

/// What is left of J_b v+ = s' - dt (gamma - s'') / 2 [m/s].
double ContactSteps::slip_left()
{
  if (!scene_.rows)
    return 0.0;
  const VectorXd gained = (touching_.v1 - free_.v) / plan_.dt;
  mechanics_.move(free_.q, free_.v, still_);
  rows_.evaluate(scene_, mechanics_.data, free_.q, free_.v, still_);
  const VectorXd wanted = -0.5 * plan_.dt * rows_.acceleration;
  const VectorXd velocity = touching_.v1 + 0.5 * plan_.dt * (a - gained);
  mechanics_.move(free_.q, velocity, still_);
  rows_.evaluate(scene_, mechanics_.data, free_.q, velocity, still_);
  return largest(rows_.velocity - wanted);
}

void ContactSteps::errors(double * eight)
{
  at(step_);
  eight[0] = natural, eight[1] = momentum_left(impulses() / plan_.dt), eight[2] = slip_left();
  at(step_ + 1);
  mechanics_.move(q, still_, still_);
  rows_.evaluate(scene_, mechanics_.data, q, still_, still_);
  candidates.gaps(mechanics_.data, q, gap_there_);
  eight[3] = largest(rows_.c);
  eight[4] = gap_there_.size() ? std::max(0.0, -gap_there_.minCoeff()) : 0.0;
  eight[5] = 0.0 - work[0], eight[6] = work[1], eight[7] = work[2];
}

void ContactSteps::measure(const VectorXd & q, const VectorXd & v, double * numbers)
{
  mechanics_.move(q, v, still_);
  rows_.evaluate(scene_, mechanics_.data, q, v, still_);
  write_measures(scene_, mechanics_.data, rows_, q, v, numbers);
}
} // namespace condyn
