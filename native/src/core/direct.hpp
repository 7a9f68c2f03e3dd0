// Direct: rows of every kind, by one factorisation in the metric of M (`MinimumNorm`).
//
// What `DenseKKT` and `NullSpace` answer: both are exact, so that nothing but rounding tells them from
// it. Where Python's may meet a singular matrix, nothing is answered.
#pragma once
#include "jacobian.hpp"
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
  VectorXd scene_forces() const override { return lam_; }
  double pivots_left() override;
  void begin(int rank) override { nearest_.resize(0, 0), rank_ = rank; }
  bool closes_by_its_factor() const override { return false; }
  bool close(const VectorXd & q, const VectorXd & v, VectorXd & dq, VectorXd & dv) override;

private:
  bool factorise(const VectorXd & q);

  int rank_ = 0; // that a factor of `close` is to have
  std::vector<Moved> moved_;
  Rows rows_;
  MinimumNorm factors_;
  VectorXd a_, lam_;
  const VectorXd zero_;
  MatrixXd M_, J_;
  MatrixXd nearest_; // M^-1 J^T G^+ (nv, m) at `made_at_`, which `close` uses again nearby
  VectorXd made_at_;
};
} // namespace condyn
