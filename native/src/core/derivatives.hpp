// Derivatives of an answer by the implicit function theorem, in the metric of M (`MinimumNorm`):
//
//   M da - J^T dlam = r,    J da = s,    r = dtau - r_q dq - r_v dv,    s = -s_q dq - s_v dv
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
  MatrixXd along_redundant_rows(const VectorXd & q, const VectorXd & lam);

  const Scene & scene_;
  Linearisation linearisation_;
  MinimumNorm factors_;
};
} // namespace condyn
