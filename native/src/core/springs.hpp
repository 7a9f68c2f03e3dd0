// The springs and dampers between frames of a model: torques, and what is inertia of them in a step.
//
//   tau = -J^T (k (l - l0) n + c n n . J v),    r' = J v,    n = r / l
//   K3 = k n n^T + max(k (1 - l0 / l), 0) (1 - n n^T),    D3 = c n n^T
//   dt D + dt^2 K = J^T (dt D3 + dt^2 K3) J = U^T w U
//
// `condyn_pin/model/springs.py` has the same in Python, and `simulation/system.py` says what for.
#pragma once
#include "jacobian.hpp"

namespace condyn
{
/// U^T w U, what springs add to M in a step [kg, kg m^2]; no rows where there are none.
struct SpringInertia
{
  MatrixXd U;
  VectorXd w;

  VectorXd operator*(const VectorXd & x) const { return U.transpose() * w.cwiseProduct(U * x); }
  MatrixXd matrix() const { return U.transpose() * w.asDiagonal() * U; }
};

/// The coordinates that each spring ties: between them M is full with what it adds.
std::vector<std::vector<int>> ties(const Scene & scene);

class Springs
{
public:
  explicit Springs(const Scene & scene);

  bool none() const { return springs_.empty(); }
  /// Looks at a configuration, after joint Jacobians.
  void at(const Data & data);
  /// Adds their torques to tau; those at the end of a step dt, were it not for a.
  void pull(const VectorXd & v, double dt, VectorXd & tau) const;
  SpringInertia inertia(double dt) const;
  /// Adds to f (nv, nv) how their impulses in a step change with q, at fixed v+; after `at` with the same data. False
  /// where ends coincide, and nothing says in which direction they will pull.
  bool add_slopes(const VectorXd & v1, double dt, const Data & data, Eigen::Ref<MatrixXd> f) const;

private:
  void turn(
    std::size_t s, const Data & data, const Vector3d & g, const VectorXd & w, MatrixXd & of_force,
    Eigen::Matrix3Xd & of_rate) const;

  const Model & model_;
  const std::vector<SpringDamper> & springs_;
  std::vector<Moved> moved_; // of each: side one is b
  std::vector<int> joint_of_; // each coordinate
  std::vector<Line> lines_;
  MatrixXd J_; // of r (3 springs, nv)
};
} // namespace condyn
