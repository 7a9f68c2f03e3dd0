// The terms of  M a + h = tau + J^T lam,  J a + gamma = 0,  for the dense methods.
#pragma once

#include "scene.hpp"

namespace condyn
{

class Terms
{
public:
  explicit Terms(const Scene & scene);

  void compute(const In & q, const In & v);

  /// Only the upper triangle is filled.
  const MatrixXd & M() const { return data_.M; }
  const VectorXd & h() const { return data_.nle; }
  const MatrixXd & J() const { return J_; }
  const VectorXd & gamma() const { return gamma_; }

private:
  const Scene & scene_;
  Data data_;
  MatrixXd J_;
  VectorXd gamma_;
};

} // namespace condyn
