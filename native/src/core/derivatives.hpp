// Derivatives of an answer by the implicit function theorem, in the metric of M (`MinimumNorm`):
//
//   M da - J^T dlam = r,    J da = s,    r = dtau - r_q dq - r_v dv,    s = -s_q dq - s_v dv
//
// Where rows are redundant dlam is that of the smallest lam: with N the left null space of J and
// lam = J w, w the smallest in the metric of M, N^T dlam = N^T (dJ w).
#pragma once
#include "jacobian.hpp"
#include "loads.hpp"
#include "minimum_norm.hpp"
#include "partials.hpp"

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
  void linearise(
    const VectorXd & q, const VectorXd & v, const VectorXd & a, const VectorXd & lam, const Loads & loads,
    const Data & placed);
  void turn(const Push & push, const Vector6d & wrench);
  void write(std::size_t i, const VectorXd & lam);
  MatrixXd along_redundant_rows(const VectorXd & q, const VectorXd & lam);
  MatrixXd turning(const VectorXd & q, const VectorXd & w);

  const Scene & scene_;
  Data data_;
  Forces on_joint_;
  std::vector<Moved> moved_; // of each constraint
  MinimumNorm factors_;
  MatrixXd rhs_, J_; // r above s, by q, v and tau
};
} // namespace condyn
