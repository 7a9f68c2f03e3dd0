// Steps of the integrators: which accelerations they ask for, and where they lead.
//
//   v1 = v + h a,    q1 = q (+) h v1          semi-implicit Euler
//   v1 = v + h a_m,  q1 = q (+) h v_m         the midpoint rules
//   v1 = v + h/6 (a1 + 2 a2 + 2 a3 + a4)      Runge-Kutta, and the same of y'
//
// in the coordinates y and V of a step, in which a stands for V'.
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
    V_ = v + h * (a_ + floating_.turning(v));
    y_ = h * V_;
    go(q, y_, V_, q1_, v);
    q.swap(q1_);
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
  y_ = h * (v + h / 2 * a_middle_);
  V_ = v + h * a_middle_;
  go(q, y_, V_, q1_, v);
  q.swap(q1_);
  a_middle_ = floating_.own(y_, a_middle_); // for the next step
  return true;
}

/// One iteration for the acceleration in the middle of the step.
bool Mover::improve(const VectorXd & q, const VectorXd & v)
{
  const double half = plan_.dt / 2;
  V_ = v + half * a_middle_;
  y_ = half * V_;
  go(q, y_, V_, middle_q_, middle_v_);
  VectorXd a = floating_.own(y_, a_middle_) - floating_.turning(middle_v_);
  at(now_ + 1);
  torque(middle_q_, middle_v_, 0.0);
  tau_ += inertia_.cwiseProduct(a);
  if (!springs_.none())
    tau_ += of_springs_ * a;
  if (!solve(middle_q_, middle_v_, a, Inertia::heavy))
    return false;
  a_middle_ = floating_.carried(y_, middle_v_, a);
  return true;
}

/// Iterates until what is left no longer halves in two iterations, as `fixed_point_iteration` does.
bool Mover::iterate(const VectorXd & q, const VectorXd & v)
{
  const double size = std::max({1.0, plan_.reach, q.cwiseAbs().maxCoeff()});
  const double small = 1e-11 * size, rounding = 1e-15 * size, h = plan_.dt;
  double two_before = INFINITY, before = INFINITY;
  a_middle_ = a_ + floating_.turning(v);
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
  if (!known_ && !acceleration(q, v, a_, 0.0, Inertia::plain))
    return false;
  const VectorXd A1 = a_ + floating_.turning(v);
  VectorXd A2, A3, A4, r2(v.size()), r3(v.size()), r4(v.size()), a(v.size());
  const auto slope = [&](int halves, VectorXd & r, VectorXd & A) {
    at(now_ + halves);
    chart_.rate(y_, V_, r);
    go(q, y_, V_, middle_q_, middle_v_);
    if (!acceleration(middle_q_, middle_v_, a, 0.0, Inertia::plain))
      return false;
    A = floating_.carried(y_, middle_v_, a);
    return true;
  };
  y_ = half * v, V_ = v + half * A1;
  if (!slope(1, r2, A2))
    return false;
  y_ = half * r2, V_ = v + half * A2;
  if (!slope(1, r3, A3))
    return false;
  y_ = h * r3, V_ = v + h * A3;
  if (!slope(2, r4, A4))
    return false;
  y_ = sixth * (v + 2.0 * (r2 + r3) + r4);
  V_ = v + sixth * (A1 + 2.0 * (A2 + A3) + A4);
  go(q, y_, V_, q1_, v);
  q.swap(q1_);
  return true;
}
} // namespace condyn
