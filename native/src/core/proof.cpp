#include "proof.hpp"
#include <pinocchio/algorithm/kinematics.hpp>
#include <pinocchio/algorithm/rnea.hpp>

namespace condyn
{
namespace
{
/// NaN where there is one, which Eigen's maximum may miss.
double largest(const VectorXd & x)
{
  double found = 0;
  for (Eigen::Index i = 0; i < x.size(); ++i)
    if (!(std::abs(x[i]) <= found))
      found = std::abs(x[i]);
  return found;
}
} // namespace

Proof::Proof(const Scene & scene)
: scene_(scene), data_(scene.model), rows_(scene.rows), on_joint_(scene.model.njoints, Force::Zero())
, r_(scene.model.nv), torque_(scene.model.nv)
{}

Sizes Proof::operator()(
  const VectorXd & q, const VectorXd & v, const VectorXd & tau, const VectorXd & a, const VectorXd & lam)
{
  pinocchio::forwardKinematics(scene_.model, data_, q, v, a);
  rows_.evaluate(scene_, data_, q, v, a);
  if (scene_.kp != 0 || scene_.kd != 0)
    rows_.acceleration += scene_.kd * rows_.velocity + scene_.kp * rows_.c;
  for (auto & f : on_joint_)
    f.setZero();
  torque_.setZero();
  add_wrenches(scene_, data_, lam, on_joint_, torque_);
  pinocchio::rnea(scene_.model, data_, q, v, a, on_joint_);
  r_ = (data_.tau - tau - torque_).cwiseAbs();
  return {largest(r_), largest(a), largest(rows_.c), largest(rows_.velocity), largest(rows_.acceleration),
          largest(lam), scene_.weights.dot(r_)};
}
} // namespace condyn
