// Proximal: Pinocchio's constraintDynamics, with another weight where the usual one does not do.
//
//   lam_(k+1) = lam_k + (G + mu I)^-1 (b - G lam_k),    G = J M^-1 J^T
//
// `condyn_pin/dynamics/solvers/proximal.py` and `proximal_mu.py` say why; the numbers come from there.
#pragma once
#include "solver.hpp"
#include <optional>

namespace condyn
{
class Proximal : public Solver
{
public:
  explicit Proximal(const Scene & scene);

  const VectorXd & acceleration(const VectorXd & q, const VectorXd & v, const VectorXd & tau) override;
  VectorXd scene_forces() const override;
  double pivots_left() override;
  bool is_exact() const override;
  void begin(int rank) override;
  bool closes_by_its_factor() const override { return true; }
  bool close(const VectorXd & q, const VectorXd & v, VectorXd & dq, VectorXd & dv) override;

private:
  std::optional<pinocchio::ProximalSettings> better();

  std::vector<Rigid> constraints;
  std::vector<RigidData> datas;
  VectorXd lam; // of Pinocchio's rows
  MatrixXd gaps_;

  pinocchio::ProximalSettings settings_;
  bool reweighted_ = false; // whether the factor in `data` is that of another weight
};
} // namespace condyn
