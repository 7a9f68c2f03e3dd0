// Templates that most files use, compiled once, by instantiate.cpp; read by the precompiled header.
#pragma once
#include "pinocchio.hpp"

#include <Eigen/Dense>

#ifndef CONDYN_EXTERN
  #define CONDYN_EXTERN extern
#endif

namespace pinocchio
{
// Not ModelTpl, whose `check()` does not compile (4.1), nor the variants, whose joints have no operator==.
CONDYN_EXTERN template struct DataTpl<double, 0, condyn::Joints>;
CONDYN_EXTERN template struct JointModelTpl<double, 0, condyn::Joints>;
CONDYN_EXTERN template struct JointDataTpl<double, 0, condyn::Joints>;
} // namespace pinocchio

namespace Eigen
{
CONDYN_EXTERN template class CompleteOrthogonalDecomposition<MatrixXd>;
CONDYN_EXTERN template class ColPivHouseholderQR<MatrixXd>;
CONDYN_EXTERN template class HouseholderQR<MatrixXd>;
CONDYN_EXTERN template class PartialPivLU<MatrixXd>;
CONDYN_EXTERN template class LLT<MatrixXd>;
CONDYN_EXTERN template class LDLT<MatrixXd>;
} // namespace Eigen
