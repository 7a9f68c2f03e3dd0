#include "tick_terms.hpp"
#include <pinocchio/algorithm/center-of-mass.hpp>
#include <pinocchio/algorithm/centroidal.hpp>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/joint-configuration.hpp>
#include <pinocchio/algorithm/kinematics.hpp>
#include <pinocchio/algorithm/rnea.hpp>

namespace condyn
{
TickTerms::TickTerms(const Scene & scene)
: scene(scene), data(scene.model), rows_(scene.rows), still_(VectorXd::Zero(scene.model.nv))
{
  for (const auto & k : scene.constraints)
    moved_.emplace_back(scene.model, k);
}

void TickTerms::place(const VectorXd & q_now)
{
  q = q_now;
  pinocchio::crba(scene.model, data, q, pinocchio::Convention::WORLD); // leaves the Jacobians of the joints behind
  M = data.M.selfadjointView<Eigen::Upper>();
  write_jacobian(scene, data, moved_, J);
}

void TickTerms::move(const VectorXd & v_now)
{
  v = v_now;
  const Model & model = scene.model;
  h = pinocchio::nonLinearEffects(model, data, q, v);
  pinocchio::forwardKinematics(model, data, q, v, still_);
  rows_.evaluate(scene, data, q, v, still_);
  wanted = -rows_.acceleration - scene.kd * rows_.velocity - scene.kp * rows_.c;
}

Vector3d TickTerms::center_of_mass(MatrixXd & J_c, Vector3d & velocity, Vector3d & drift)
{
  pinocchio::centerOfMass(scene.model, data, pinocchio::KinematicLevel::ACCELERATION, false);
  velocity = data.vcom[0], drift = data.acom[0];
  J_c = pinocchio::jacobianCenterOfMass(scene.model, data, false);
  return data.com[0];
}

Vector3d TickTerms::angular_momentum(MatrixXd & J_L, Vector3d & drift)
{
  pinocchio::computeCentroidalMomentumTimeVariation(scene.model, data);
  drift = data.dhg.angular();
  const Vector3d momentum = data.hg.angular();
  J_L = pinocchio::ccrba(scene.model, data, q, v).bottomRows<3>();
  return momentum;
}

VectorXd TickTerms::way_to(const VectorXd & q_r) const
{
  VectorXd way(scene.model.nv);
  pinocchio::difference(scene.model, q, q_r, way);
  return way;
}
} // namespace condyn
