// Pinocchio 3.9, with the joints that are compiled. Its headers alone: nothing of it is linked.
#pragma once

// Pinocchio asks variants for kinds of joints that this list does not have.
#define BOOST_VARIANT_USE_RELAXED_GET_BY_DEFAULT

#include <pinocchio/multibody/model.hpp>
#include <pinocchio/multibody/data.hpp>
#include <pinocchio/algorithm/contact-info.hpp>
#include <pinocchio/algorithm/proximal.hpp>

#include <Eigen/Core>

#include <vector>

namespace condyn
{

using Eigen::MatrixXd;
using Eigen::VectorXd;
using In = Eigen::Map<const VectorXd>;
using Out = Eigen::Map<VectorXd>;

/// Pinocchio's own list without joints made of others, which are most of what it takes to compile.
template<typename S, int O>
struct Joints
{
  using Scalar = S;
  enum
  {
    Options = O
  };

#define CONDYN_LIST(kind)                                                                          \
  boost::variant<                                                                                  \
    pinocchio::Joint##kind##RevoluteTpl<S, O, 0>, pinocchio::Joint##kind##RevoluteTpl<S, O, 1>,    \
    pinocchio::Joint##kind##RevoluteTpl<S, O, 2>, pinocchio::Joint##kind##FreeFlyerTpl<S, O>,      \
    pinocchio::Joint##kind##PlanarTpl<S, O>, pinocchio::Joint##kind##RevoluteUnalignedTpl<S, O>,   \
    pinocchio::Joint##kind##SphericalTpl<S, O>, pinocchio::Joint##kind##SphericalZYXTpl<S, O>,     \
    pinocchio::Joint##kind##PrismaticTpl<S, O, 0>, pinocchio::Joint##kind##PrismaticTpl<S, O, 1>,  \
    pinocchio::Joint##kind##PrismaticTpl<S, O, 2>,                                                 \
    pinocchio::Joint##kind##PrismaticUnalignedTpl<S, O>,                                           \
    pinocchio::Joint##kind##TranslationTpl<S, O>,                                                  \
    pinocchio::Joint##kind##RevoluteUnboundedTpl<S, O, 0>,                                         \
    pinocchio::Joint##kind##RevoluteUnboundedTpl<S, O, 1>,                                         \
    pinocchio::Joint##kind##RevoluteUnboundedTpl<S, O, 2>,                                         \
    pinocchio::Joint##kind##RevoluteUnboundedUnalignedTpl<S, O>,                                   \
    pinocchio::Joint##kind##HelicalTpl<S, O, 0>, pinocchio::Joint##kind##HelicalTpl<S, O, 1>,      \
    pinocchio::Joint##kind##HelicalTpl<S, O, 2>, pinocchio::Joint##kind##HelicalUnalignedTpl<S, O>, \
    pinocchio::Joint##kind##UniversalTpl<S, O>>

  using JointModelVariant = CONDYN_LIST(Model);
  using JointDataVariant = CONDYN_LIST(Data);
#undef CONDYN_LIST
};

using Model = pinocchio::ModelTpl<double, 0, Joints>;
using Data = pinocchio::DataTpl<double, 0, Joints>;
using JointModel = pinocchio::JointModelTpl<double, 0, Joints>;
using Rigid = pinocchio::RigidConstraintModel;
using RigidData = pinocchio::RigidConstraintData;

} // namespace condyn
