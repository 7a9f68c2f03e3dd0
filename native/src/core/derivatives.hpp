// Derivatives of an answer by the implicit function theorem, in the metric of M as `MinimumNorm` in Python:
//
//   M da - J^T dlam = r,    J da = s,    r = dtau - r_q dq - r_v dv,    s = -s_q dq - s_v dv
//
//   M = L L^T,    J L^-T = B Q^T,    y = L^-1 r,    z = B^+ s - Q^T y
//   L^T da = y + Q z,    dlam = B^+T z
//
// with Q of orthonormal columns and B of full rank: R^T of L^-1 J^T = Q R where rows are independent, and
// with pivots on the columns where they are not. There dlam is that of the smallest lam: with N the left
// null space of J and lam = J w, w the smallest in the metric of M, N^T dlam = N^T (dJ w).
#pragma once
#include "partials.hpp"

namespace condyn
{
/// What Python knows of the scene at its nominal state.
struct Rank
{
  bool dependent; // whether there are redundant rows
  double least; // |J|^2 of a J that is more than rounding
};

class Derivatives
{
public:
  Derivatives(const Scene & scene, const Rank & rank);

  /// Writes da/dq, da/dv, da/dtau, dlam/dq, dlam/dv, dlam/dtau; false where the rank is in doubt.
  bool operator()(
    const VectorXd & q, const VectorXd & v, const VectorXd & a, const VectorXd & lam, double * const out[6]);

private:
  void linearise(const VectorXd & q, const VectorXd & v, const VectorXd & a, const VectorXd & lam);
  void write(std::size_t i, const VectorXd & lam);
  bool independent();
  bool minimum_norm(const VectorXd & q, const VectorXd & lam);
  MatrixXd turning(const VectorXd & q, const VectorXd & w);

  const Scene & scene_;
  const Rank rank_;
  Data data_;
  Forces on_joint_;
  std::vector<std::vector<int>> columns_; // of each constraint: the coordinates that move a side of it
  std::vector<std::vector<char>> moves1_, moves2_; // and which
  MatrixXd rhs_, J_; // r above s, by q, v and tau
  MatrixXd L_, Q_, null_;
  MatrixXd B_inverse_; // B^+ (rank, m)
};
} // namespace condyn
