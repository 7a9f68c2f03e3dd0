// Steps of the integrators: which accelerations they ask for, and where they lead.
//
//   v1 = v + h a,    q1 = q (+) h v1          semi-implicit Euler
//   v1 = v + h a_m,  q1 = q (+) h v_m         the midpoint rules
//   v1 = v + h/6 (a1 + 2 a2 + 2 a3 + a4)      Runge-Kutta, and the same of theta'
#include "motion.hpp"
#include <pinocchio/algorithm/joint-configuration.hpp>

namespace condyn
{
bool Mover::step(VectorXd & q, VectorXd & v)
{
  const double h = plan_.dt;
  switch (plan_.integrator)
  {
  case Integrator::semi_implicit:
  case Integrator::explicit_forces:
    if (!known_ && !acceleration(q, v, a_, drag_, first_))
      return false;
    v += h * a_;
    along_ = h * v;
    move(q, along_);
    return true;
  case Integrator::linear_midpoint:
    if (!begun_)
    {
      begun_ = true;
      if (!improve(q, v))
        return false;
    }
    if (!improve(q, v))
      return false;
    break;
  case Integrator::implicit_midpoint:
    if ((!known_ && !acceleration(q, v, a_, 0.0, Inertia::plain)) || !iterate(q, v))
      return false;
    break;
  case Integrator::runge_kutta_4: return runge_kutta(q, v);
  }
  along_ = h * (v + h / 2 * a_middle_);
  move(q, along_);
  v += h * a_middle_;
  return true;
}

/// One iteration for the acceleration in the middle of the step.
bool Mover::improve(const VectorXd & q, const VectorXd & v)
{
  const double half = plan_.dt / 2;
  middle_v_ = v + half * a_middle_;
  along_ = half * middle_v_;
  pinocchio::integrate(scene_.model, q, along_, middle_q_);
  at(now_ + 1);
  torque(middle_q_, middle_v_, 0.0);
  tau_ += inertia_.cwiseProduct(a_middle_);
  if (!springs_.none())
    tau_ += of_springs_ * a_middle_;
  return solve(middle_q_, middle_v_, a_middle_, Inertia::heavy);
}

/// Iterates until what is left no longer halves in two iterations, as `fixed_point_iteration` does.
bool Mover::iterate(const VectorXd & q, const VectorXd & v)
{
  const double size = std::max({1.0, plan_.reach, q.cwiseAbs().maxCoeff()});
  const double small = 1e-11 * size, rounding = 1e-15 * size, h = plan_.dt;
  double two_before = INFINITY, before = INFINITY;
  a_middle_ = a_;
  for (int count = 0; count < 60; ++count)
  {
    const VectorXd last = a_middle_;
    if (!improve(q, v))
      return false;
    const double left = h * h * (a_middle_ - last).cwiseAbs().maxCoeff();
    if (left <= rounding || (before < small && !(left < two_before / 2)))
      return true;
    two_before = before, before = left;
    if (!std::isfinite(left))
      return false;
  }
  return before < small;
}

bool Mover::runge_kutta(VectorXd & q, VectorXd & v)
{
  const double h = plan_.dt, half = h / 2, sixth = h / 6;
  VectorXd a2, a3, a4, r2(v.size()), r3(v.size()), r4(v.size()), theta, stage;
  if (!known_ && !acceleration(q, v, a_, 0.0, Inertia::plain))
    return false;
  const auto slope = [&](int halves, VectorXd & r, VectorXd & a) {
    at(now_ + halves);
    chart_.rate(theta, stage, r);
    pinocchio::integrate(scene_.model, q, theta, middle_q_);
    return acceleration(middle_q_, stage, a, 0.0, Inertia::plain);
  };
  theta = half * v, stage = v + half * a_;
  if (!slope(1, r2, a2))
    return false;
  theta = half * r2, stage = v + half * a2;
  if (!slope(1, r3, a3))
    return false;
  theta = h * r3, stage = v + h * a3;
  if (!slope(2, r4, a4))
    return false;
  theta = sixth * (v + 2.0 * (r2 + r3) + r4);
  move(q, theta);
  v += sixth * (a_ + 2.0 * (a2 + a3) + a4);
  return true;
}
} // namespace condyn
