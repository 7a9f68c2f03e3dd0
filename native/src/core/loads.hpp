// Loads: what forces from outside do to the joints.
//
//   tau_f = J_f^T f
//
// with J_f the Jacobian of the frame, at its origin and in the axes of f (`condyn_pin/constraints/forces.py`).
// The proof takes the same forces another way: as wrenches on the bodies, through Newton-Euler.
#pragma once
#include "pinocchio.hpp"
#include <pinocchio/algorithm/jacobian.hpp>

namespace condyn
{
/// Where a force acts, and whose axes it keeps its components in.
struct Push
{
  int joint;
  SE3 placement;
  bool in_world;
};

/// The forces of one state.
class Loads
{
public:
  Loads(const Model & model, const std::vector<Push> & pushes)
  : on_joint(model.njoints, Force::Zero()), torque(VectorXd::Zero(model.nv))
  , wrenches(pushes.size(), Vector6d::Zero()), pushes(pushes), model_(model), data_(model)
  {}

  /// `six` has force and moment of each, one after the other.
  void at(const VectorXd & q, const double * six)
  {
    if (pushes.empty())
      return;
    pinocchio::computeJointJacobians(model_, data_, q);
    torque.setZero();
    for (auto & f : on_joint)
      f.setZero();
    for (std::size_t i = 0; i < pushes.size(); ++i)
    {
      const Push & push = pushes[i];
      const SE3 E = data_.oMi[push.joint] * push.placement;
      const Force given(Eigen::Map<const Vector6d>(six + 6 * i));
      const Matrix3d R = push.in_world ? Matrix3d(E.rotation().transpose()) : Matrix3d(Matrix3d::Identity());
      const SE3 axes(push.in_world ? Matrix3d(Matrix3d::Identity()) : E.rotation(), E.translation());
      for (auto above : model_.supports[push.joint])
        for (int j = model_.idx_vs[above]; above && j < model_.idx_vs[above] + model_.nvs[above]; ++j)
        {
          const Motion column = axes.actInv(Motion(data_.J.col(j).head<3>(), data_.J.col(j).tail<3>()));
          torque[j] += column.toVector().dot(given.toVector());
        }
      wrenches[i] << R * given.linear(), R * given.angular();
      on_joint[push.joint] += push.placement.act(Force(wrenches[i]));
    }
  }

  Forces on_joint; // in the axes of the joints
  VectorXd torque; // sum_f J_f^T f
  std::vector<Vector6d> wrenches; // in the axes of the frames
  const std::vector<Push> pushes;

private:
  const Model & model_;
  Data data_;
};
} // namespace condyn
