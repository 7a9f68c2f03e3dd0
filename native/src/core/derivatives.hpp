// Derivatives of an answer by the implicit function theorem, as `KktDerivatives` in Python:
//
//   M da - J^T dlam = dtau - r_q dq - r_v dv,        J da = -s_q dq - s_v dv
//
//   [ M  -J^T ]^-1   [ M^-1  0 ]   [ Y K ]
//   [ J    0  ]    = [  0    0 ] + [  K  ] [ -(Y K)^T  K^T ],    Y = M^-1 J^T,    K K^T = (J Y)^+
//
// Where rows are independent K is U^-1 of J Y = U^T U. Where they are not, with pivots on the columns
// of J L^-T = B Q^T of full rank, K = B (B^T B)^-1; and dlam is that of the smallest lam: with N the
// left null space of J and lam = J w, N^T dlam = N^T (dJ w).
#pragma once
#include "partials.hpp"

namespace condyn
{
/// What Python knows of the scene at its nominal state.
struct Rank
{
  bool dependent; // whether there are redundant rows
  double least; // |J|^2 of a J that is more than rounding
  bool ill; // whether M is so badly conditioned that each product is corrected
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
  /// The inverse times x, with the products of `rhs` apart.
  MatrixXd solve(const MatrixXd & x) const;

  const Scene & scene_;
  const Rank rank_;
  Data data_;
  Forces on_joint_;
  std::vector<std::vector<int>> columns_; // of each constraint: the coordinates that move a side of it
  std::vector<std::vector<char>> moves1_, moves2_; // and which
  MatrixXd rhs_, J_, M_, M_inv_, L_, Y_, K_, left_, null_;
};
} // namespace condyn
