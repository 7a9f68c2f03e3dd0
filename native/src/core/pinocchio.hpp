// The headers of Pinocchio, and the kinds of joints that are compiled.
#pragma once
#include "older_libm.hpp"
// Pinocchio asks variants for kinds of joints that ours does not have.
#define BOOST_VARIANT_USE_RELAXED_GET_BY_DEFAULT
#include <pinocchio/config.hpp>
#include <pinocchio/multibody.hpp>
#include <pinocchio/constraints.hpp>
#include <pinocchio/algorithm/proximal.hpp>
#include <Eigen/Core>
#include <vector>

namespace condyn
{
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using Matrix6x = Eigen::Matrix<double, 6, Eigen::Dynamic>;
using Vector6d = Eigen::Matrix<double, 6, 1>;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using In = Eigen::Map<const VectorXd>;
using Out = Eigen::Map<VectorXd>;
using pinocchio::Force;
using pinocchio::Motion;
using pinocchio::SE3;

/// The kinds of joints that are compiled. Pinocchio's own list has 25, and some algorithms are
/// compiled for each of them again: ours takes half of the time and memory.
template<typename S, int O>
struct Joints
{
  using Scalar = S;
  enum { Options = O };
  template<int axis> using R = pinocchio::JointModelRevoluteTpl<S, O, axis>;
  template<int axis> using P = pinocchio::JointModelPrismaticTpl<S, O, axis>;
  using JointModelVariant = boost::variant<
    R<0>, R<1>, R<2>, pinocchio::JointModelFreeFlyerTpl<S, O>, pinocchio::JointModelRevoluteUnalignedTpl<S, O>,
    pinocchio::JointModelSphericalTpl<S, O>, P<0>, P<1>, P<2>, pinocchio::JointModelPrismaticUnalignedTpl<S, O>>;
  template<int axis> using Rd = pinocchio::JointDataRevoluteTpl<S, O, axis>;
  template<int axis> using Pd = pinocchio::JointDataPrismaticTpl<S, O, axis>;
  using JointDataVariant = boost::variant<
    Rd<0>, Rd<1>, Rd<2>, pinocchio::JointDataFreeFlyerTpl<S, O>, pinocchio::JointDataRevoluteUnalignedTpl<S, O>,
    pinocchio::JointDataSphericalTpl<S, O>, Pd<0>, Pd<1>, Pd<2>, pinocchio::JointDataPrismaticUnalignedTpl<S, O>>;
};

using Model = pinocchio::ModelTpl<double, 0, Joints>;
using Data = pinocchio::DataTpl<double, 0, Joints>;
using Joint = pinocchio::JointModelTpl<double, 0, Joints>;
using Rigid = pinocchio::RigidConstraintModel;
using RigidData = pinocchio::RigidConstraintData;
using Forces = pinocchio::container::aligned_vector<Force>;
} // namespace condyn
