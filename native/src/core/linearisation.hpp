// The two equations, linearised at an answer: what a step of q and v leaves of them, at fixed a and lam.
//
//   r = M a + h - tau - J^T lam,    s = J a + gamma - a_ref
//
// `condyn_pin/dynamics/derivatives/linearised.py` has the same in Python.
#pragma once
#include "jacobian.hpp"
#include "loads.hpp"

namespace condyn
{
class Linearisation
{
public:
  explicit Linearisation(const Scene & scene);

  /// `placed` has the placements of joints at q.
  void at(
    const VectorXd & q, const VectorXd & v, const VectorXd & a, const VectorXd & lam, const Loads & loads,
    const Data & placed);

  /// How J w changes with q while w stays: as the slip does at v = w; after `at` the same q.
  MatrixXd turning(const VectorXd & q, const VectorXd & w);

  MatrixXd r, s; // [-r_q, -r_v] (nv, 2 nv) and [-s_q, -s_v] (rows, 2 nv)
  MatrixXd J;
  Data data; // as Newton-Euler's derivatives leave it

private:
  void turn(const Push & push, const Vector6d & wrench);
  void write(std::size_t i, const VectorXd & lam);

  const Scene & scene_;
  Forces on_joint_;
  std::vector<Moved> moved_; // of each constraint
};
} // namespace condyn
