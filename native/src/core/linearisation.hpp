// The two equations, linearised at an answer: what a step of q and v leaves of them, at fixed a and lam.
//
//   r = M a + h - tau - J^T lam,    s = J a + gamma - a_ref
//
// `condyn_pin/dynamics/derivatives/kkt.py` has the same in Python.
#pragma once
#include "carried.hpp"
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

  /// Where `asked` may not be zero.
  Carried touched() const;

  /// How J w changes with q while w stays: as the slip does at v = w; where `at` was last.
  MatrixXd turning(const VectorXd & w);

  auto r() const { return asked.topRows(scene_.model.nv); } // [-r_q, -r_v] (nv, 2 nv)
  auto s() const { return asked.bottomRows(scene_.rows); } // [-s_q, -s_v] (rows, 2 nv)
  MatrixXd asked; // r above s
  MatrixXd J;
  Data data; // as Newton-Euler's derivatives leave it

private:
  void turn(const Push & push, const Vector6d & wrench);
  void write(std::size_t i, const VectorXd & lam);
  void turn_pair(const Moved & moved, const Constraint & k);

  const Scene & scene_;
  Forces on_joint_;
  VectorXd of_couplings_; // J^T lam that does not change
  std::vector<Moved> moved_; // of each constraint
  Matrix6x J1_, J2_, w1_, w2_; // of the coordinates that move one constraint
};
} // namespace condyn
