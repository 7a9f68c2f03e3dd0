// Proximal: Pinocchio's constraintDynamics, with another weight where the usual one does not do.
//
//   lam_(k+1) = lam_k + (G + mu I)^-1 (b - G lam_k),    G = J M^-1 J^T
//
// Springs on top of M, U^T w U, take U^T f with f = w U a; a falls with f as G = U P U^T says, P the inverse inertia
// that the constraints leave:
//
//   U a = U a_0 - G f,    (1 / w + G) f = U a_0
//
// Where rows look independent though they are redundant on closed loops, or stand for others, states off the constraints
// are answered by `Direct`.
//
// `condyn_pin/dynamics/solvers/proximal.py` and `dynamics/mu.py` say why; the numbers come from there.
#pragma once
#include "direct.hpp"
#include <memory>
#include <optional>

namespace condyn
{
class Proximal : public Solver
{
public:
  explicit Proximal(const Scene & scene);

  const VectorXd & acceleration(const VectorXd & q, const VectorXd & v, const VectorXd & tau) override;
  VectorXd scene_forces() override;
  double pivots_left() override;
  void begin(int rank) override;
  bool closes_by_its_factor() const override { return true; }
  bool close(const VectorXd & q, const VectorXd & v, VectorXd & dq, VectorXd & dv) override;

private:
  bool is_off() const;
  bool moves() const;
  const VectorXd & by_rows(const VectorXd & q, const VectorXd & v, const VectorXd & tau);
  void answer(const VectorXd & q, const VectorXd & v, const VectorXd & tau);
  std::optional<pinocchio::ProximalSettings> better();
  MatrixXd freed(const MatrixXd & forces);

  std::vector<Rigid> constraints;
  std::vector<RigidData> datas;
  VectorXd lam; // of Pinocchio's rows
  MatrixXd gaps_;
  std::unique_ptr<Direct> direct_; // where some states are not Pinocchio's
  bool by_rows_ = false; // whether the last one was not
  bool approximates_ = false; // whether some rows stand for others
  VectorXd q_; // of the last one

  pinocchio::ProximalSettings settings_;
  double mu_; // of the factor in `data`
};
} // namespace condyn
