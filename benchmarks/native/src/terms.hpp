// The terms of  M a + h = tau + Jᵀ lam,  J a + gamma = 0.
#pragma once

#include "scene.hpp"

namespace condyn
{

/// Built from crba, nonLinearEffects and the joint Jacobian alone, so that the errors of the other
/// methods are computed by a route which those methods did not take.
class Terms
{
public:
  explicit Terms(const Scene & scene);

  void compute(const State & state);

  /// Only the upper triangle is filled.
  const Eigen::MatrixXd & M() const { return data_.M; }
  const Eigen::VectorXd & h() const { return data_.nle; }
  const Eigen::MatrixXd & J() const { return J_; }
  const Eigen::VectorXd & gamma() const { return gamma_; }

private:
  const pinocchio::Model & model_;
  const Constraints & constraints_;
  pinocchio::Data data_;
  Eigen::MatrixXd J_;
  Eigen::VectorXd gamma_;
};

} // namespace condyn
