// Joints that turn about more than one axis: how far a step of theirs goes, and its coordinates.
//
//   theta' = Jr(theta)^-1 w = w + theta x w / 2 + k theta x (theta x w),    k = (1 - (t/2) cot(t/2)) / t^2
#pragma once
#include "pinocchio.hpp"
#include <cmath>
#include <utility>

namespace condyn
{
class Chart
{
public:
  explicit Chart(const Model & model)
  {
    for (int j = 1; j < model.njoints; ++j)
      if (model.nvs[j] > 1)
        joints_.emplace_back(model.idx_vs[j], model.nvs[j]);
  }

  /// Whether a body turns further in a step than one chart goes.
  bool turns_too_far(const VectorXd & v, double dt) const
  {
    if (joints_.empty() || !(v.squaredNorm() > M_PI * M_PI / (dt * dt)))
      return false;
    for (const auto & [i, size] : joints_)
      if (!(v.segment<3>(i + size - 3).norm() * dt <= M_PI))
        return true;
    return false;
  }

  /// y' where V is the velocity, both of a step (`condyn_pin/simulation/manifold.py`).
  void rate(const VectorXd & y, const VectorXd & V, VectorXd & out) const
  {
    out = V;
    for (const auto & [i, size] : joints_)
    {
      const Vector3d theta = y.segment<3>(i + size - 3), w = V.segment<3>(i + size - 3);
      const double square = theta.squaredNorm(), half = 0.5 * std::sqrt(square);
      const double k =
        square < 1e-4 ? 1.0 / 12 + square / 720 : (1 - half * std::cos(half) / std::sin(half)) / square;
      const Vector3d across = theta.cross(w);
      out.segment<3>(i + size - 3) += 0.5 * across + k * theta.cross(across);
    }
  }

private:
  std::vector<std::pair<int, int>> joints_; // where v begins for each, and how much of it
};
} // namespace condyn
