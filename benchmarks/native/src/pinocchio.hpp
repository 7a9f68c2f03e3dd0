// The only file that knows which Pinocchio is installed: 3.9 or 4.x.
#pragma once

#include <pinocchio/config.hpp>

#if PINOCCHIO_MAJOR_VERSION >= 4
  #include <pinocchio/multibody.hpp>
  #include <pinocchio/constraints.hpp>
#else
  #include <pinocchio/multibody/model.hpp>
  #include <pinocchio/multibody/data.hpp>
  #include <pinocchio/algorithm/contact-info.hpp>
#endif

#include <pinocchio/algorithm/proximal.hpp>

#include <vector>

namespace condyn
{

using Constraints = std::vector<pinocchio::RigidConstraintModel>;
using ConstraintDatas = std::vector<pinocchio::RigidConstraintData>;

inline int rows(const pinocchio::RigidConstraintModel & constraint)
{
  return constraint.type == pinocchio::CONTACT_6D ? 6 : 3;
}

inline int rows(const Constraints & constraints)
{
  int sum = 0;
  for (const auto & constraint : constraints)
    sum += rows(constraint);
  return sum;
}

/// Fresh datas: methods must not share them, LCABA overwrites fields that constraintDynamics reads.
inline ConstraintDatas create_datas(const Constraints & constraints)
{
  ConstraintDatas datas;
  for (const auto & constraint : constraints)
    datas.emplace_back(constraint);
  return datas;
}

} // namespace condyn
