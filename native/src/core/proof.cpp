#include "proof.hpp"
#include "largest.hpp"
#include <algorithm>
#include <limits>
#include <pinocchio/algorithm/jacobian.hpp>
#include <pinocchio/algorithm/kinematics.hpp>
#include <pinocchio/algorithm/rnea.hpp>

namespace condyn
{
namespace
{
/// Newton-Euler from the bodies back to the root, after forward kinematics with a: M a + h less what the
/// wrenches on the joints do. `rnea` would go through the kinematics once more.
const VectorXd & newton_euler(const Model & model, Data & data, const VectorXd & a, const Forces & on_joint)
{
  for (int i = 1; i < model.njoints; ++i)
  {
    const auto & Y = model.inertias[i];
    Motion felt = data.a[i];
    felt.linear() -= data.oMi[i].rotation().transpose() * model.gravity.linear();
    data.f[i] = Y * felt + data.v[i].cross(Y * data.v[i]) - on_joint[i];
  }
  data.tau = model.armature.cwiseProduct(a);
  using Step = pinocchio::impl::RneaBackwardStep<double, 0, Joints>;
  for (int i = model.njoints - 1; i > 0; --i)
    Step::run(model.joints[i], data.joints[i], Step::ArgsType(model, data));
  return data.tau;
}

/// Error over eps of the direction of a vector, off by eps `by`: at most 1 / eps.
double tilt(double by, double over)
{
  return by > 0 ? by / std::max(over, std::numeric_limits<double>::epsilon() * by) : 0.0;
}

/// Largest error of a direction of rods, wheels and crosses, over eps: `shares` in Python.
double lean(const Scene & scene, const Data & data)
{
  double most = 0;
  for (const Constraint & k : scene.constraints)
  {
    if (k.kind == Kind::rod)
    {
      const auto & one = data.oMi[k.joint1], & two = data.oMi[k.joint2];
      const auto &p1 = k.placement1.translation(), &p2 = k.placement2.translation();
      const double reach = one.translation().norm() + p1.norm() + two.translation().norm() + p2.norm();
      most = std::max(most, 1 + tilt(reach, (two.act(p2) - one.act(p1)).norm()));
    }
    else if (k.is_cross())
    {
      const Matrix3d R1 = data.oMi[k.joint1].rotation() * k.placement1.rotation();
      const Cross cross(k, R1.transpose() * data.oMi[k.joint2].rotation() * k.placement2.rotation());
      Vector3d sizes = cross.w.cwiseAbs();
      for (int i = 0; i < 3; ++i)
        sizes += cross.rate(Vector3d::Unit(i)).cwiseAbs();
      most = std::max({most, 1.0, sizes.maxCoeff()});
    }
    else if (k.kind == Kind::roll && k.axis >= 0)
    {
      const Vector3d e = data.oMi[k.joint1].rotation() * k.placement1.rotation().col(k.axis);
      const double size = e.cross(k.placement2.rotation().col(2)).norm();
      most = std::max(most, 1 + tilt(size > 1e-12, size)); // FLAT in Python
    }
  }
  return most;
}
} // namespace

Proof::Proof(const Scene & scene)
: scene_(scene), data_(scene.model), rows_(scene.rows), on_joint_(scene.model.njoints, Force::Zero())
, r_(scene.model.nv), torque_(scene.model.nv), redundancy_(scene)
{
  for (const auto & k : scene.constraints)
    moved_.emplace_back(scene.model, k);
}

void Proof::place_rows()
{
  pinocchio::computeJointJacobians(scene_.model, data_);
  write_jacobian(scene_, data_, moved_, J_);
}

/// What is left out of the rows at the state that was evaluated.
const Redundancy & Proof::redundant()
{
  place_rows();
  redundancy_.at(J_, rows_.c);
  return redundancy_;
}

Sizes Proof::operator()(
  const VectorXd & q, const VectorXd & v, const VectorXd & tau, const VectorXd & a, const VectorXd & lam,
  const Loads * loads, const Redundancy * left)
{
  pinocchio::forwardKinematics(scene_.model, data_, q, v, a);
  rows_.evaluate(scene_, data_, q, v, a);
  if (scene_.kp != 0 || scene_.kd != 0)
    rows_.acceleration += scene_.kd * rows_.velocity + scene_.kp * rows_.c;
  const double violation = largest(rows_.c), velocity = largest(rows_.velocity);
  double changes = 0;
  if (std::max(violation, velocity) > scene_.precision.open)
  {
    if (left)
      place_rows();
    else
      left = &redundant();
    // |M^-1 x|_j <= w_j w.|x|, with the weights of the nominal state
    const VectorXd pull = scene_.weights * scene_.weights.dot((J_.transpose() * lam).cwiseAbs());
    changes = left->changes(v, a, pull, rows_.velocity, scene_.verdict.gravity);
    if (violation > scene_.precision.open || velocity > scene_.precision.moving)
      left->leave_out_of(rows_.acceleration);
  }
  for (std::size_t i = 0; i < on_joint_.size(); ++i)
    on_joint_[i] = loads ? loads->on_joint[i] : Force::Zero();
  torque_.setZero();
  add_wrenches(scene_, data_, lam, on_joint_, torque_);
  r_ = (newton_euler(scene_.model, data_, a, on_joint_) - tau - torque_).cwiseAbs();
  return {largest(r_), largest(a), violation, velocity, largest(rows_.acceleration), largest(lam),
          scene_.weights.dot(r_), lean(scene_, data_), changes};
}
} // namespace condyn
