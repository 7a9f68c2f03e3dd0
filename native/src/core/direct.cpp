#include "direct.hpp"
#include <pinocchio/algorithm/cholesky.hpp>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/joint-configuration.hpp>
#include <pinocchio/algorithm/kinematics.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#include <limits>

namespace condyn
{
namespace
{
const double near = 0.02; // a factor is used until a joint has moved so far [rad, m]: _NEAR in Python
} // namespace

Direct::Direct(const Scene & scene)
: Solver(scene), rows_(scene.rows), factors_(scene), lam_(VectorXd::Zero(scene.rows))
, zero_(VectorXd::Zero(model.nv))
{
  for (const auto & k : scene.constraints)
    moved_.emplace_back(model, k);
  iterations = 1;
}

const VectorXd & Direct::acceleration(const VectorXd & q, const VectorXd & v, const VectorXd & tau)
{
  pinocchio::forwardKinematics(model, data, q, v, zero_);
  rows_.evaluate(scene, data, q, v, zero_);
  const VectorXd missing = -(rows_.acceleration + scene.kd * rows_.velocity + scene.kp * rows_.c);
  a_ = tau - pinocchio::nonLinearEffects(model, data, q, v);
  if (factorise(q))
    lam_ = factors_.solve(a_, missing);
  else
    a_.setConstant(std::numeric_limits<double>::quiet_NaN()), lam_.setConstant(a_[0]);
  return a_;
}

bool Direct::factorise(const VectorXd & q)
{
  pinocchio::crba(model, data, q, pinocchio::Convention::WORLD);
  M_ = data.M;
  if (springs.w.size())
    M_ += springs.matrix();
  write_jacobian(scene, data, moved_, J_);
  return scene.method == Method::independent ? factors_.factorise_independent(M_, J_) : factors_.factorise(M_, J_);
}

double Direct::pivots_left()
{
  if (scene.watched.empty())
    return 1.0;
  pinocchio::cholesky::decompose(model, data);
  return share_of_pivots(data.D);
}

bool Direct::close(const VectorXd & q, const VectorXd & v, VectorXd & dq, VectorXd & dv)
{
  pinocchio::forwardKinematics(model, data, q, v, zero_);
  rows_.evaluate(scene, data, q, v, zero_);
  if (!nearest_.size() || pinocchio::difference(model, made_at_, q).cwiseAbs().maxCoeff() > near)
  {
    if (!factorise(q) || factors_.rank() != rank_)
      return false;
    nearest_.noalias() = factors_.U * factors_.K.transpose();
    made_at_ = q;
  }
  dq = -(nearest_ * rows_.c), dv = -(nearest_ * rows_.velocity);
  return true;
}
} // namespace condyn
