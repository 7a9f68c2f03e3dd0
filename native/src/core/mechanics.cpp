#include "mechanics.hpp"
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/jacobian.hpp>
#include <pinocchio/algorithm/joint-configuration.hpp>
#include <pinocchio/algorithm/kinematics.hpp>
#include <pinocchio/algorithm/rnea.hpp>

namespace condyn
{
void Mechanics::mass(const VectorXd & q, MatrixXd & M)
{
  pinocchio::crba(model, data, q, pinocchio::Convention::WORLD);
  M = data.M.selfadjointView<Eigen::Upper>();
}

const VectorXd & Mechanics::bias(const VectorXd & q, const VectorXd & v)
{
  return pinocchio::nonLinearEffects(model, data, q, v);
}

void Mechanics::jacobians(const VectorXd & q) { pinocchio::computeJointJacobians(model, data, q); }

void Mechanics::place(const VectorXd & q) { pinocchio::forwardKinematics(model, data, q); }

void Mechanics::move(const VectorXd & q, const VectorXd & v, const VectorXd & a)
{
  pinocchio::forwardKinematics(model, data, q, v, a);
}

const VectorXd & Mechanics::inverse_dynamics(
  const VectorXd & q, const VectorXd & v, const VectorXd & a, const Forces & f)
{
  return pinocchio::rnea(model, data, q, v, a, f);
}

void Mechanics::integrate(const VectorXd & q, const VectorXd & along, VectorXd & moved)
{
  pinocchio::integrate(model, q, along, moved);
}

VectorXd Mechanics::difference(const VectorXd & q0, const VectorXd & q1)
{
  VectorXd along(model.nv);
  pinocchio::difference(model, q0, q1, along);
  return along;
}

void Mechanics::integrate_partials(
  const VectorXd & q, const VectorXd & along, MatrixXd & by_start, MatrixXd & by_move)
{
  by_start.setZero(model.nv, model.nv), by_move.setZero(model.nv, model.nv);
  pinocchio::dIntegrate(model, q, along, by_start, pinocchio::ARG0);
  pinocchio::dIntegrate(model, q, along, by_move, pinocchio::ARG1);
}
} // namespace condyn
