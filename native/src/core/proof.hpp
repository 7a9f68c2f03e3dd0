// The proof of an answer: both residuals by other algorithms than the one it came from.
//
//   r = M a + h - tau - J^T lam        by Newton-Euler, lam as forces on the bodies
//   s = J a + gamma - a_ref            by forward kinematics
//
// Of a state that is off its constraints s is that of the rows that count (`Redundancy`).
#pragma once
#include "jacobian.hpp"
#include "loads.hpp"
#include "redundancy.hpp"
#include "rows.hpp"

namespace condyn
{
class Proof
{
public:
  explicit Proof(const Scene & scene);

  /// `left` is what the answer leaves out, if that is known.
  Sizes operator()(
    const VectorXd & q, const VectorXd & v, const VectorXd & tau, const VectorXd & a, const VectorXd & lam,
    const Loads * loads = nullptr, const Redundancy * left = nullptr);

  /// Kinematics of the last state that was looked at.
  const Data & data() const { return data_; }

private:
  void place_rows(); // J at the last state that was looked at
  const Redundancy & redundant();

  const Scene & scene_;
  Data data_;
  Rows rows_;
  Forces on_joint_;
  VectorXd r_, torque_;
  std::vector<Moved> moved_; // of each constraint
  MatrixXd J_;
  Redundancy redundancy_;
};
} // namespace condyn
