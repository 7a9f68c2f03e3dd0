// Direct: rows of every kind, by one factorisation in the metric of M (`MinimumNorm`).
//
// What `DenseKKT` and `NullSpace` answer: both are exact, so that nothing but rounding tells them from
// it. Where Python's may meet a singular matrix, nothing is answered.
#pragma once
#include "jacobian.hpp"
#include "largest.hpp"
#include "minimum_norm.hpp"
#include "rows.hpp"
#include "solver.hpp"

namespace condyn
{
class Direct : public Solver
{
public:
  explicit Direct(const Scene & scene);

  const VectorXd & acceleration(const VectorXd & q, const VectorXd & v, const VectorXd & tau) override;
  VectorXd scene_forces() override { return without_idle(lam_); }
  double pivots_left() override;
  void begin(int rank) override { nearest_.resize(0, 0), rank_ = rank; }
  bool closes_by_its_factor() const override { return false; }
  bool close(const VectorXd & q, const VectorXd & v, VectorXd & dq, VectorXd & dv) override;

  /// Evaluates c and J v.
  void look(const VectorXd & q, const VectorXd & v);
  /// |c| and |J v| of the last look.
  double gap() const { return largest(rows_.c); }
  double slip() const { return largest(rows_.velocity); }
  /// |c|^2 of the constraint that is open widest.
  double widest_squared() const;
  /// The acceleration at the last look.
  const VectorXd & answer(const VectorXd & q, const VectorXd & v, const VectorXd & tau);
  /// What is redundant at q, where loops are closed.
  const Redundancy & redundant_at(const VectorXd & q);

private:
  void weigh(const VectorXd & q);
  bool factorise();
  bool factorise_kept(VectorXd & missing);

  int rank_ = 0; // that a factor of `close` is to have
  std::vector<Moved> moved_;
  Rows rows_;
  MinimumNorm factors_;
  Redundancy redundancy_;
  VectorXd a_, lam_;
  const VectorXd zero_;
  MatrixXd M_, J_;
  MatrixXd nearest_; // M^-1 J^T G^+ (nv, m) at `made_at_`, which `close` uses again nearby
  VectorXd made_at_;
};
} // namespace condyn
