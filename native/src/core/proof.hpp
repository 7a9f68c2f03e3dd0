// The proof of an answer: both residuals by other algorithms than the one it came from.
//
//   r = M a + h - tau - J^T lam        by Newton-Euler, lam as forces on the bodies
//   s = J a + gamma - a_ref            by forward kinematics
#pragma once
#include "loads.hpp"
#include "rows.hpp"

namespace condyn
{
class Proof
{
public:
  explicit Proof(const Scene & scene);

  Sizes operator()(
    const VectorXd & q, const VectorXd & v, const VectorXd & tau, const VectorXd & a, const VectorXd & lam,
    const Loads * loads = nullptr);

  /// Kinematics of the last state that was looked at.
  const Data & data() const { return data_; }

private:
  const Scene & scene_;
  Data data_;
  Rows rows_;
  Forces on_joint_;
  VectorXd r_, torque_;
};
} // namespace condyn
