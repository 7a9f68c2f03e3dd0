// Joints that turn about more than one axis: how far one chart of theirs goes, and its velocities.
//
//   q (+) theta,    theta' = Jr(theta)^-1 v
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

  /// theta' where the velocity is v.
  void rate(const VectorXd & theta, const VectorXd & v, VectorXd & out) const
  {
    out = v;
    for (const auto & [i, size] : joints_)
    {
      if (size == 6)
      {
        SE3::Matrix6 J;
        pinocchio::Jlog6(pinocchio::exp6(Motion(theta.segment<6>(i))), J);
        out.segment<6>(i).noalias() = J * v.segment<6>(i);
      }
      else if (size == 3)
      {
        Matrix3d J;
        pinocchio::Jlog3(pinocchio::exp3(theta.segment<3>(i)), J);
        out.segment<3>(i).noalias() = J * v.segment<3>(i);
      }
    }
  }

private:
  std::vector<std::pair<int, int>> joints_; // where v begins for each, and how much of it
};
} // namespace condyn
