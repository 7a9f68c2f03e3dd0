#include "terms.hpp"

#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/rnea.hpp>

namespace condyn
{
namespace
{

using pinocchio::JointIndex;
using pinocchio::Motion;
using pinocchio::SE3;
using Vector3 = Eigen::Vector3d;

/// The motion of a constraint frame, in its own axes; a is what the joints do without accelerating.
struct FrameMotion
{
  SE3 placement; // in the world
  Motion v, a;
};

FrameMotion frame_motion(
  const Model & model, const Data & data, JointIndex joint, const SE3 & placement)
{
  if (joint == 0)
    return {placement, Motion::Zero(), Motion::Zero()};
  // Pinocchio's a_gf has gravity as an upward acceleration of the world: take it out again.
  const Motion a = data.a_gf[joint] + data.oMi[joint].actInv(model.gravity);
  return {data.oMi[joint] * placement, placement.actInv(data.v[joint]), placement.actInv(a)};
}

template<typename Visit>
void for_columns_that_move(const Model & model, JointIndex joint, Visit && visit)
{
  for (const JointIndex ancestor : model.supports[joint])
    if (ancestor > 0)
      for (int i = 0; i < model.nvs[ancestor]; ++i)
        visit(model.idx_vs[ancestor] + i);
}

/// Both ends of a weld are seen in frame 1, so the columns of common ancestors cancel exactly.
template<typename Rows>
void weld_rows(
  const Model & model,
  const Data::Matrix6x & world_J,
  const Rigid & constraint,
  const FrameMotion & frame1,
  Rows J)
{
  const auto add = [&](JointIndex joint, double sign) {
    for_columns_that_move(model, joint, [&](int column) {
      const Motion motion(world_J.col(column));
      J.col(column) += sign * frame1.placement.actInv(motion).toVector();
    });
  };
  add(constraint.joint1_id, 1.);
  add(constraint.joint2_id, -1.);
}

template<typename Rows>
void ball_rows(
  const Model & model,
  const Data::Matrix6x & world_J,
  const Rigid & constraint,
  const FrameMotion & frame1,
  const FrameMotion & frame2,
  Rows J)
{
  const Eigen::Matrix3d to_frame1 = frame1.placement.rotation().transpose();
  const auto add = [&](JointIndex joint, const Vector3 & point, double sign) {
    for_columns_that_move(model, joint, [&](int column) {
      const Vector3 linear = world_J.col(column).head<3>();
      const Vector3 angular = world_J.col(column).tail<3>();
      J.col(column) += sign * (to_frame1 * (linear + angular.cross(point)));
    });
  };
  add(constraint.joint1_id, frame1.placement.translation(), 1.);
  add(constraint.joint2_id, frame2.placement.translation(), -1.);
}

Motion weld_drift(const FrameMotion & frame1, const FrameMotion & frame2)
{
  const SE3 frame1_to_2 = frame1.placement.actInv(frame2.placement);
  const Motion v2 = frame1_to_2.act(frame2.v);
  return frame1.a - frame1_to_2.act(frame2.a) + (frame1.v - v2).cross(v2);
}

Vector3 ball_drift(const FrameMotion & frame1, const FrameMotion & frame2)
{
  const auto point_acceleration = [](const FrameMotion & frame) -> Vector3 {
    return frame.a.linear() + frame.v.angular().cross(frame.v.linear());
  };
  return point_acceleration(frame1)
         - frame1.placement.rotation().transpose()
             * (frame2.placement.rotation() * point_acceleration(frame2));
}

} // namespace

Terms::Terms(const Scene & scene)
: scene_(scene)
, data_(scene.model)
, J_(scene.rows, scene.model.nv)
, gamma_(scene.rows)
{
}

void Terms::compute(const In & q, const In & v)
{
  const Model & model = scene_.model;
  // in the world convention crba leaves the joint Jacobian and placements behind
  pinocchio::crba(model, data_, q, pinocchio::Convention::WORLD);
  pinocchio::nonLinearEffects(model, data_, q, v);

  J_.setZero();
  int row = 0;
  for (const auto & constraint : scene_.constraints)
  {
    const auto frame1 =
      frame_motion(model, data_, constraint.joint1_id, constraint.joint1_placement);
    const auto frame2 =
      frame_motion(model, data_, constraint.joint2_id, constraint.joint2_placement);
    if (constraint.type == pinocchio::CONTACT_6D)
    {
      weld_rows(model, data_.J, constraint, frame1, J_.middleRows<6>(row));
      gamma_.segment<6>(row) = weld_drift(frame1, frame2).toVector();
      row += 6;
    }
    else
    {
      ball_rows(model, data_.J, constraint, frame1, frame2, J_.middleRows<3>(row));
      gamma_.segment<3>(row) = ball_drift(frame1, frame2);
      row += 3;
    }
  }
}

} // namespace condyn
