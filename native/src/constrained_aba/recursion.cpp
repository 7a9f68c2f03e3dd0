#include "recursion.hpp"

#include <pinocchio/spatial/explog.hpp>

#include <algorithm>

namespace condyn
{

using pinocchio::JointIndex;
using pinocchio::Motion;
using pinocchio::SE3;

Recursion::Recursion(const Scene & scene, const Settings & settings)
: Method(scene, settings)
, data(scene.model)
, lack(VectorXd::Zero(scene.rows))
, placed(std::any_of(scene.Kp.begin(), scene.Kp.end(), [](double Kp) { return Kp != 0.0; }))
{
  pinocchio::initPvSolver(model, data, scene.constraints);
  std::vector<int> columns(std::size_t(model.njoints), 0);
  int row = 0;
  for (std::size_t k = 0; k < scene.constraints.size(); ++k)
  {
    const JointIndex joint = scene.constraints[k].joint1_id;
    const int size = scene.size(k);
    Contact contact{k, joint, row, columns[joint], size, data.KA[joint].middleCols(columns[joint], size)};
    contacts.push_back(contact);
    columns[joint] += size;
    row += size;
  }
}

void Recursion::out_along_the_tree(const In & q, const In & v, const In & tau)
{
  data.v[0].setZero();
  data.f[0].setZero();
  data.a_gf[0] = -model.gravity; // an acceleration of the world upwards is as good as weight
  data.a[0] = data.a_gf[0];
  data.u = tau;
  for (JointIndex i = 1; i < JointIndex(model.njoints); ++i)
  {
    Forward::run(model.joints[i], data.joints[i], Forward::ArgsType(model, data, q, v));
    if (placed)
      place(i);
  }
  for (const auto & contact : contacts)
  {
    auto lacks = lack.segment(contact.row, contact.size);
    lacks.noalias() = -contact.K.topRows<3>().transpose() * data.a_gf[contact.joint].linear();
    const auto & constraint = scene.constraints[contact.index];
    if (contact.size == 3) // the acceleration of a point, which is not that of a twist
    {
      const Motion twist = constraint.joint1_placement.actInv(data.v[contact.joint]);
      lacks += twist.angular().cross(twist.linear());
    }
    if (scene.Kp[contact.index] != 0.0 || scene.Kd[contact.index] != 0.0)
      lacks -= reference(contact).toVector().head(contact.size);
  }
}

void Recursion::place(JointIndex joint)
{
  const JointIndex parent = model.parents[joint];
  data.oMi[joint] = parent > 0 ? data.oMi[parent] * data.liMi[joint] : data.liMi[joint];
}

/// a_ref = -Kp e - Kd v, e being where the frame is, seen from where it should be.
Motion Recursion::reference(const Contact & contact) const
{
  const auto & constraint = scene.constraints[contact.index];
  const double Kp = scene.Kp[contact.index], Kd = scene.Kd[contact.index];
  Motion a = -Kd * constraint.joint1_placement.actInv(data.v[contact.joint]);
  if (Kp != 0.0)
  {
    const SE3 place = data.oMi[contact.joint] * constraint.joint1_placement;
    const SE3 to_target = place.actInv(constraint.joint2_placement);
    if (contact.size == 6)
      a += Kp * pinocchio::log6(to_target);
    else
      a.linear() += Kp * to_target.translation();
  }
  return a;
}

} // namespace condyn
