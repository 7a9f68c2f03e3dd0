// Combinations of rows that say nothing new where the loops are closed, as `Redundancy` in Python.
//
// Beside closed loops they are rows of their own, as large as the gap. With moves and rows in radians and sizes of the
// loops, k combinations count as long as pivots are larger than four times the move that closes the loops:
//
//   (R J D)^T P = Q T,    y = T^-T P^T R c,    T_kk > 4 |y_1..k|
//
// and never fewer than at closed states. The others are the singular subspace N of R J D, and are left out:
//
//   M a + h = tau + J^T lam,    (1 - N N^T) (J a + gamma - a_ref) = 0,    N^T lam = 0
//
// `condyn_pin/constraints/rows/redundancy.py` says why.
#pragma once
#include "orthonormal.hpp"
#include "scene.hpp"

namespace condyn
{
class Redundancy
{
public:
  explicit Redundancy(const Scene & scene) : plan_(scene.precision) {}

  /// Finds them where rows are J, open by c.
  void at(const MatrixXd & J, const VectorXd & c);

  /// Share of a that closing the loops and stopping J v changes, estimated by sizes.
  double changes(const VectorXd & v, const VectorXd & a, const VectorXd & pull, const VectorXd & rate,
                 double gravity) const;

  /// Rows (m, k) without the combinations that are left out.
  template<typename Rows>
  void leave_out_of(Rows & rows) const
  {
    if (N.cols())
      rows -= N * (N.transpose() * rows).eval();
  }

  MatrixXd N; // orthonormal combinations (m, m - rank) of the rows as they are
  double doubt = 0; // length of the closing move, or what it leaves open, over the last pivot
  int rank = 0; // rows that are kept

private:
  double pivot(int k) const { return k < rows_.rank ? rows_.R()(k, k) : 0.0; }
  double shared(double moved, const VectorXd & v, const VectorXd & a, double pull, double dv, double gravity) const;
  double rounding() const;
  int usual() const;
  int counted() const;
  VectorXd closing(int k) const;
  MatrixXd dependence() const;

  const Precision & plan_;
  Orthonormal rows_, left_; // of (R J D)^T, and of the combinations
  VectorXd gaps_; // P^T R c
  MatrixXd scaled_, combinations_;
  int most_ = 0; // rows that may be independent
  double last_ = 1; // pivot that is kept
};
} // namespace condyn
