#include "direct.hpp"
#include <pinocchio/algorithm/cholesky.hpp>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/jacobian.hpp>
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
: Solver(scene), rows_(scene.rows), factors_(scene), redundancy_(scene), lam_(VectorXd::Zero(scene.rows))
, zero_(VectorXd::Zero(model.nv))
{
  for (const auto & k : scene.constraints)
    moved_.emplace_back(model, k);
  iterations = 1;
}

const VectorXd & Direct::acceleration(const VectorXd & q, const VectorXd & v, const VectorXd & tau)
{
  look(q, v);
  return answer(q, v, tau);
}

void Direct::look(const VectorXd & q, const VectorXd & v)
{
  pinocchio::forwardKinematics(model, data, q, v, zero_);
  rows_.evaluate(scene, data, q, v, zero_);
}

double Direct::widest_squared() const
{
  double widest = 0;
  for (const auto & k : scene.constraints)
    widest = std::max(widest, rows_.c.segment(k.first, k.size).squaredNorm());
  return widest;
}

const VectorXd & Direct::answer(const VectorXd & q, const VectorXd & v, const VectorXd & tau)
{
  VectorXd missing = -(rows_.acceleration + scene.kd * rows_.velocity + scene.kp * rows_.c);
  a_ = tau - pinocchio::nonLinearEffects(model, data, q, v);
  weigh(q);
  left = nullptr;
  const bool off = gap() > scene.precision.ajar || slip() > scene.precision.open;
  if (scene.precision.looks_independent && off ? factorise_kept(missing) : factorise())
    lam_ = factors_.solve(a_, missing);
  else
    a_.setConstant(std::numeric_limits<double>::quiet_NaN()), lam_.setConstant(a_[0]);
  return a_;
}

void Direct::weigh(const VectorXd & q)
{
  pinocchio::crba(model, data, q, pinocchio::Convention::WORLD);
  M_ = data.M;
  if (springs.w.size())
    M_ += springs.matrix();
  write_jacobian(scene, data, moved_, J_);
}

bool Direct::factorise()
{
  return scene.method == Method::independent ? factors_.factorise_independent(M_, J_) : factors_.factorise(M_, J_);
}

/// Of the rows that are kept where the loops are open; `DenseKKT` has no answer where that is fewer than all.
bool Direct::factorise_kept(VectorXd & missing)
{
  redundancy_.at(J_, rows_.c);
  if (scene.method == Method::independent && redundancy_.N.cols())
    return false;
  redundancy_.leave_out_of(J_), redundancy_.leave_out_of(missing);
  left = &redundancy_;
  return factors_.factorise(M_, J_, redundancy_.rank);
}

const Redundancy & Direct::redundant_at(const VectorXd & q)
{
  pinocchio::computeJointJacobians(model, data, q);
  write_jacobian(scene, data, moved_, J_);
  redundancy_.at(J_, VectorXd::Zero(scene.rows));
  return redundancy_;
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
  look(q, v);
  if (!nearest_.size() || pinocchio::difference(model, made_at_, q).cwiseAbs().maxCoeff() > near)
  {
    weigh(q);
    if (!factorise() || factors_.rank() != rank_)
      return false;
    nearest_.noalias() = factors_.U * factors_.K.transpose();
    made_at_ = q;
  }
  dq = -(nearest_ * rows_.c), dv = -(nearest_ * rows_.velocity);
  return true;
}
} // namespace condyn
