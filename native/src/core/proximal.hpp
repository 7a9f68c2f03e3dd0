// Proximal: Pinocchio's constraintDynamics, with another weight where the usual one does not do.
//
//   lam_(k+1) = lam_k + (G + mu I)^-1 (b - G lam_k),    G = J M^-1 J^T
//
// `condyn_pin/dynamics/solvers/proximal.py` and `proximal_mu.py` say why; the numbers come from there.
#pragma once
#include "scene.hpp"
#include <optional>

namespace condyn
{
/// One thread's memory of a scene and its solver.
class Proximal
{
public:
  explicit Proximal(const Scene & scene);

  /// a; then `lam` are the forces of Pinocchio's rows, and `iterations` how many it took.
  const VectorXd & acceleration(const VectorXd & q, const VectorXd & v, const VectorXd & tau);

  VectorXd scene_forces() const;

  /// Solves [[-mu 1, J], [J^T, M]] x = rhs in place, by the factor that the last acceleration left.
  void solve_in_place(MatrixXd & rhs);

  /// What is left of the pivots of M that are watched: the least of their shares of the nominal ones.
  double pivots_left() const;
  /// Whether what stands for other rows is closed, so that it is exact.
  bool is_exact() const;

  const Scene & scene;
  Model model; // its own: integrators change the armature
  Data data;
  std::vector<Rigid> constraints;
  std::vector<RigidData> datas;
  VectorXd lam;
  int iterations = 0;

private:
  std::optional<pinocchio::ProximalSettings> better();

  pinocchio::ProximalSettings settings_;
  bool reweighted_ = false; // whether the factor in `data` is that of another weight
};
} // namespace condyn
