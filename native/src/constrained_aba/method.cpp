#include "method.hpp"

#include <stdexcept>
#include <utility>

namespace condyn
{
namespace
{

using Make = MethodPtr (*)(const Scene &, const Settings &);

const std::vector<std::pair<std::string, Make>> methods{
#if PINOCCHIO_MAJOR_VERSION >= 4
  {"pinocchio::lcaba", make_lcaba},
#else
  {"ConstrainedABA", make_constrained_aba},
  {"PV", make_pv},
  {"pinocchio::constrainedABA", make_pinocchios_constrained_aba},
  {"Dense KKT, Eigen LDLT", make_dense_ldlt},
  {"Dense KKT, blocks of Eigen LLT", make_dense_blocks},
#endif
  {"pinocchio::aba", make_aba},
  {"pinocchio::constraintDynamics", make_constraint_dynamics},
};

} // namespace

std::vector<std::string> method_names()
{
  std::vector<std::string> names;
  for (const auto & [name, make] : methods)
    names.push_back(name);
  return names;
}

MethodPtr make_method(const std::string & name, const Scene & scene, const Settings & settings)
{
  for (const auto & [known, make] : methods)
    if (known == name)
      return make(scene, settings);
  throw std::invalid_argument(name + ": no such method is compiled");
}

void check_with_world(const Scene & scene, const std::string & name)
{
  for (const auto & constraint : scene.constraints)
    if (constraint.joint2_id != 0)
      throw std::invalid_argument(name + " takes constraints with the world only");
}

} // namespace condyn
