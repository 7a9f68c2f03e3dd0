#include "scene.hpp"

#include <map>

namespace condyn
{
namespace
{

using namespace pinocchio;

template<typename Joint>
JointModel plain(const JointSpec &)
{
  return Joint();
}

template<typename Joint>
JointModel about(const JointSpec & x)
{
  return Joint(x.angular());
}

/// A screw of pitch h about e shifts by h e.
template<typename Joint>
JointModel screw(const JointSpec & x)
{
  return Joint(x.linear().dot(x.angular()));
}

template<int axis>
using Revolute = JointModelRevoluteTpl<double, 0, axis>;
template<int axis>
using Unbounded = JointModelRevoluteUnboundedTpl<double, 0, axis>;
template<int axis>
using Prismatic = JointModelPrismaticTpl<double, 0, axis>;
template<int axis>
using Helical = JointModelHelicalTpl<double, 0, axis>;

const std::map<std::string, JointModel (*)(const JointSpec &)> kinds{
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
   [](const JointSpec & x) -> JointModel { return JointModelPrismaticUnalignedTpl<double, 0>(x.linear()); }},
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
   [](const JointSpec & x) -> JointModel {
     return JointModelHelicalUnalignedTpl<double, 0>(x.angular(), x.linear().dot(x.angular()));
   }},
  {"JointModelUniversal",
   [](const JointSpec & x) -> JointModel {
     return JointModelUniversalTpl<double, 0>(x.angular(0), x.angular(1));
   }},
#endif
};

/// 3 or 6 rows: a frame of a moving joint is held at one of another joint, or of the world.
struct Numbers
{
  int rows;
  int joint1, joint2;
  SE3 placement1, placement2;
  double Kp, Kd; // of Baumgarte [1/s^2], [1/s]
};

void fill(const Fields & x, Numbers & to)
{
  x("size", to.rows)("joint1", to.joint1)("joint2", to.joint2)("placement1", to.placement1);
  x("placement2", to.placement2)("kp", to.Kp)("kd", to.Kd);
}

} // namespace

std::vector<std::string> joint_kinds()
{
  std::vector<std::string> names;
  for (const auto & [name, make] : kinds)
    names.push_back(name);
  return names;
}

Scene read_scene(const Fields & x)
{
  Scene scene;
  const Model & model = scene.model;
  read_tree(x.at("tree"), scene.model, [](const JointSpec & spec) {
    const auto found = kinds.find(spec.kind);
    want(found != kinds.end(), "the kind of a joint");
    return found->second(spec);
  });
  for (const Numbers & c : x.get<std::vector<Numbers>>("constraints"))
  {
    want(c.rows == 3 || c.rows == 6, "rows of a constraint");
    want(0 < c.joint1 && c.joint1 < model.njoints && 0 <= c.joint2 && c.joint2 < model.njoints, "joints of a constraint");
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
