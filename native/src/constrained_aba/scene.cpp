#include "scene.hpp"

#include <functional>
#include <map>
#include <stdexcept>

namespace condyn
{
namespace
{

using namespace pinocchio;

using Axis = Eigen::Vector3d;
using Subspace = Eigen::Matrix<double, 6, 2>;

Axis linear(const Subspace & S)
{
  return S.col(0).head<3>();
}

Axis angular(const Subspace & S, int column = 0)
{
  return S.col(column).tail<3>();
}

template<typename Joint>
JointModel plain(const Subspace &)
{
  return Joint();
}

template<typename Joint>
JointModel about(const Subspace & S)
{
  return Joint(angular(S));
}

/// A screw of pitch h about e shifts by h e.
template<typename Joint>
JointModel screw(const Subspace & S)
{
  return Joint(linear(S).dot(angular(S)));
}

template<int axis>
using Revolute = JointModelRevoluteTpl<double, 0, axis>;
template<int axis>
using Unbounded = JointModelRevoluteUnboundedTpl<double, 0, axis>;
template<int axis>
using Prismatic = JointModelPrismaticTpl<double, 0, axis>;
template<int axis>
using Helical = JointModelHelicalTpl<double, 0, axis>;

const std::map<std::string, std::function<JointModel(const Subspace &)>> kinds{
  {"JointModelRX", plain<Revolute<0>>},
  {"JointModelRY", plain<Revolute<1>>},
  {"JointModelRZ", plain<Revolute<2>>},
  {"JointModelPX", plain<Prismatic<0>>},
  {"JointModelPY", plain<Prismatic<1>>},
  {"JointModelPZ", plain<Prismatic<2>>},
  {"JointModelFreeFlyer", plain<JointModelFreeFlyerTpl<double, 0>>},
  {"JointModelSpherical", plain<JointModelSphericalTpl<double, 0>>},
  {"JointModelRevoluteUnaligned", about<JointModelRevoluteUnalignedTpl<double, 0>>},
  {"JointModelPrismaticUnaligned",
   [](const Subspace & S) -> JointModel { return JointModelPrismaticUnalignedTpl<double, 0>(linear(S)); }},
#if PINOCCHIO_MAJOR_VERSION < 4
  {"JointModelRUBX", plain<Unbounded<0>>},
  {"JointModelRUBY", plain<Unbounded<1>>},
  {"JointModelRUBZ", plain<Unbounded<2>>},
  {"JointModelPlanar", plain<JointModelPlanarTpl<double, 0>>},
  {"JointModelSphericalZYX", plain<JointModelSphericalZYXTpl<double, 0>>},
  {"JointModelTranslation", plain<JointModelTranslationTpl<double, 0>>},
  {"JointModelRevoluteUnboundedUnaligned", about<JointModelRevoluteUnboundedUnalignedTpl<double, 0>>},
  {"JointModelHX", screw<Helical<0>>},
  {"JointModelHY", screw<Helical<1>>},
  {"JointModelHZ", screw<Helical<2>>},
  {"JointModelHelicalUnaligned",
   [](const Subspace & S) -> JointModel {
     return JointModelHelicalUnalignedTpl<double, 0>(angular(S), linear(S).dot(angular(S)));
   }},
  {"JointModelUniversal",
   [](const Subspace & S) -> JointModel {
     return JointModelUniversalTpl<double, 0>(angular(S, 0), angular(S, 1));
   }},
#endif
};

} // namespace

std::vector<std::string> joint_kinds()
{
  std::vector<std::string> names;
  for (const auto & [name, make] : kinds)
    names.push_back(name);
  return names;
}

Scene make_scene(
  const std::vector<JointNumbers> & joints, const Eigen::Vector3d & gravity, const VectorXd & armature,
  const std::vector<ConstraintNumbers> & constraints)
{
  Scene scene;
  Model & model = scene.model;
  for (const auto & joint : joints)
  {
    const auto found = kinds.find(joint.kind);
    if (found == kinds.end())
      throw std::invalid_argument(joint.kind + ": no such joint is compiled");
    if (joint.parent < 0 || joint.parent >= model.njoints)
      throw std::invalid_argument("parents: a joint must come after its parent");
    const std::string name = "joint " + std::to_string(model.njoints);
    const JointIndex id =
      model.addJoint(JointIndex(joint.parent), found->second(joint.S), joint.placement, name);
    // written, not appended to nothing, which would round
    model.inertias[id] = Inertia(joint.mass, joint.lever, Symmetric3(joint.inertia));
  }
  model.gravity.linear() = gravity;
  if (armature.size() != model.nv)
    throw std::invalid_argument("armature: one number for each of v is needed");
  model.armature = armature;

  for (const auto & c : constraints)
  {
    if (c.rows != 3 && c.rows != 6)
      throw std::invalid_argument("constraints: of 3 and of 6 rows only");
    if (c.joint1 <= 0 || c.joint1 >= model.njoints || c.joint2 < 0 || c.joint2 >= model.njoints)
      throw std::invalid_argument("constraints: the joints of one are not in the tree");
    scene.constraints.emplace_back(
      c.rows == 6 ? CONTACT_6D : CONTACT_3D, model, JointIndex(c.joint1), c.placement1,
      JointIndex(c.joint2), c.placement2, LOCAL);
    scene.Kp.push_back(c.Kp);
    scene.Kd.push_back(c.Kd);
    scene.rows += c.rows;
  }
  return scene;
}

} // namespace condyn
