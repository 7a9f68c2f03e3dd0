// The inequalities of a tick: torques, accelerations of joints, cones.
#include "tick_program.hpp"
#include <cmath>
#include <limits>

namespace condyn
{
void TickProgram::write_inequalities()
{
  const Eigen::Index n = torque_.cols(), k = qp.split, m = touch_.rows();
  const Eigen::Index motors = spec_.limited.size(), joints = spec_.accelerations.columns.size(), r = cones_.rows();
  qp.C.setZero(n, motors + joints + r), qp.lower.resize(motors + joints + r), qp.upper.resize(motors + joints + r);
  for (Eigen::Index i = 0; i < motors; ++i)
  {
    qp.C.col(i) = torque_.row(spec_.limited[i]).transpose();
    qp.lower[i] = -spec_.torque[i] - torque_0_[spec_.limited[i]];
    qp.upper[i] = spec_.torque[i] - torque_0_[spec_.limited[i]];
  }
  write_accelerations(motors);
  qp.C.block(k, motors + joints, m, r) = cones_.transpose();
  qp.lower.tail(r).setConstant(-std::numeric_limits<double>::infinity());
  qp.upper.tail(r).setZero();
}

void TickProgram::write_accelerations(Eigen::Index first)
{
  const AccelerationLimits & limits = spec_.accelerations;
  if (limits.columns.empty())
    return;
  VectorXd upper = limits.most, lower = -limits.most;
  if (const double dt = limits.dt; dt > 0)
  {
    upper = upper.cwiseMin((limits.speed - terms_.v) / dt);
    lower = lower.cwiseMax((-limits.speed - terms_.v) / dt);
    for (std::size_t i = 0; i < limits.at_v.size(); ++i)
    {
      const int at = limits.at_v[i];
      const double ahead = terms_.q[limits.at_q[i]] + dt * terms_.v[at];
      upper[at] = std::min(upper[at], 2 * (limits.highest[i] - ahead) / (dt * dt));
      lower[at] = std::max(lower[at], 2 * (limits.lowest[i] - ahead) / (dt * dt));
    }
  }
  for (std::size_t i = 0; i < limits.columns.size(); ++i)
  {
    const int at = limits.columns[i];
    if (!holds_)
      qp.C(at, first + i) = 1.0;
    else if (elimination_.N.row(at).norm() > spec_.rank) // more than rounding leaves of a unit vector
      qp.C.col(first + i).head(qp.split) = elimination_.N.row(at).transpose();
    qp.lower[first + i] = lower[at] - a_0_[at], qp.upper[first + i] = upper[at] - a_0_[at];
  }
}

bool TickProgram::turn_cones()
{
  for (const auto & cone : spec_.turning)
  {
    const Constraint & k = scene_.constraints[cone.constraint];
    const Matrix3d R = axes_of(k, terms_.data);
    Matrix3d T = cone.floor * R;
    if (cone.edge >= 0)
    {
      const Vector3d n = R.transpose() * cone.floor.row(0).transpose(), x = Vector3d::Unit(cone.edge);
      if (!(std::abs(n.dot(x)) <= spec_.parallel))
        return false;
      const Vector3d z = (n - n.dot(x) * x).normalized();
      T << x.transpose(), z.cross(x).transpose(), z.transpose();
    }
    MatrixXd turned(cone.A.rows(), cone.A.cols());
    for (Eigen::Index i = 0; i < cone.A.cols(); i += 3)
      turned.middleCols(i, 3) = cone.A.middleCols(i, 3) * T;
    cones_.block(cone.row, cone.column, cone.A.rows(), cone.to_wrench.cols()) = turned * cone.to_wrench;
  }
  return true;
}
} // namespace condyn
