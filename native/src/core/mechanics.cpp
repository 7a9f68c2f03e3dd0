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
  pinocchio::crba(model, data, q);
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
} // namespace condyn
