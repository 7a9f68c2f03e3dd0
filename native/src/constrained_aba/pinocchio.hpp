// Pinocchio, 3.9 or 4.1, with the joints that are compiled. Headers alone: nothing is linked.
#pragma once

// Pinocchio asks variants for kinds of joints that this list does not have.
#define BOOST_VARIANT_USE_RELAXED_GET_BY_DEFAULT

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

#include <Eigen/Core>

#include <vector>

namespace condyn
{

using Eigen::MatrixXd;
using Eigen::VectorXd;
using In = Eigen::Map<const VectorXd>;
using Out = Eigen::Map<VectorXd>;

#define CONDYN_USUAL(kind)                                                                         \
  pinocchio::Joint##kind##RevoluteTpl<S, O, 0>, pinocchio::Joint##kind##RevoluteTpl<S, O, 1>,      \
    pinocchio::Joint##kind##RevoluteTpl<S, O, 2>, pinocchio::Joint##kind##FreeFlyerTpl<S, O>,      \
    pinocchio::Joint##kind##RevoluteUnalignedTpl<S, O>,                                            \
    pinocchio::Joint##kind##SphericalTpl<S, O>, pinocchio::Joint##kind##PrismaticTpl<S, O, 0>,     \
    pinocchio::Joint##kind##PrismaticTpl<S, O, 1>, pinocchio::Joint##kind##PrismaticTpl<S, O, 2>,  \
    pinocchio::Joint##kind##PrismaticUnalignedTpl<S, O>
#define CONDYN_OTHERS(kind)                                                                        \
  pinocchio::Joint##kind##PlanarTpl<S, O>, pinocchio::Joint##kind##SphericalZYXTpl<S, O>,          \
    pinocchio::Joint##kind##TranslationTpl<S, O>,                                                  \
    pinocchio::Joint##kind##RevoluteUnboundedTpl<S, O, 0>,                                         \
    pinocchio::Joint##kind##RevoluteUnboundedTpl<S, O, 1>,                                         \
    pinocchio::Joint##kind##RevoluteUnboundedTpl<S, O, 2>,                                         \
    pinocchio::Joint##kind##RevoluteUnboundedUnalignedTpl<S, O>,                                   \
    pinocchio::Joint##kind##HelicalTpl<S, O, 0>, pinocchio::Joint##kind##HelicalTpl<S, O, 1>,      \
    pinocchio::Joint##kind##HelicalTpl<S, O, 2>,                                                   \
    pinocchio::Joint##kind##HelicalUnalignedTpl<S, O>, pinocchio::Joint##kind##UniversalTpl<S, O>

/// Pinocchio's own list without joints made of others, which are most of what it takes to compile;
/// with 4.1 those of the robots alone, since lcaba is compiled for every pair of joints.
template<typename S, int O>
struct Joints
{
  using Scalar = S;
  enum
  {
    Options = O
  };
#if PINOCCHIO_MAJOR_VERSION >= 4
  using JointModelVariant = boost::variant<CONDYN_USUAL(Model)>;
  using JointDataVariant = boost::variant<CONDYN_USUAL(Data)>;
#else
  using JointModelVariant = boost::variant<CONDYN_USUAL(Model), CONDYN_OTHERS(Model)>;
  using JointDataVariant = boost::variant<CONDYN_USUAL(Data), CONDYN_OTHERS(Data)>;
#endif
};

using Model = pinocchio::ModelTpl<double, 0, Joints>;
using Data = pinocchio::DataTpl<double, 0, Joints>;
using JointModel = pinocchio::JointModelTpl<double, 0, Joints>;
using Rigid = pinocchio::RigidConstraintModel;
using RigidData = pinocchio::RigidConstraintData;

} // namespace condyn
