// Derivatives of an answer by the implicit function theorem, in the metric of M (`MinimumNorm`):
//
//   M da - J^T dlam = r,    J da = s,    r = dtau - r_q dq - r_v dv,    s = -s_q dq - s_v dv
//
// The inverse of that is formed: by tau it is the answer, and by q and v a coordinate asks little of it (`Carried`).
//
// Where rows are redundant dlam is that of the smallest lam: with N the left null space of J and
// lam = J w, w the smallest in the metric of M, N^T dlam = N^T (dJ w).
#pragma once
#include "linearisation.hpp"
#include "minimum_norm.hpp"

namespace condyn
{
class Derivatives
{
public:
  explicit Derivatives(const Scene & scene);

  /// Writes da/dq, da/dv, da/dtau, dlam/dq, dlam/dv, dlam/dtau; false where the rank is in doubt. `placed` has
  /// the placements of joints at q.
  bool operator()(
    const VectorXd & q, const VectorXd & v, const VectorXd & a, const VectorXd & lam, const Loads & loads,
    const Data & placed, double * const out[6]);

private:
  MatrixXd along_redundant_rows(const VectorXd & lam);
  void write(double * const out[6]) const;

  const Scene & scene_;
  Linearisation linearisation_;
  const Carried carried_;
  MinimumNorm factors_;
  MatrixXd inverse_, by_state_; // (nv + rows, nv + rows), and of q and v (nv + rows, 2 nv)
};
} // namespace condyn
