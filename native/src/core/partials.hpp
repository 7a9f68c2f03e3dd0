// How the rows of one constraint change with q and v, at fixed accelerations and forces.
//
// What a coordinate does is taken at the two ends (`Column`), in the axes of c1. With the slip delta of c1
// past c2 that a step of the coordinate makes,
//
//   d(R x) = -delta_ang x (R x) + R dx,    dr = -delta_lin,    d(X y) = -delta x (X y) + X dy,
//
// and the rows follow by the product rule. A force that is fixed in c1 turns in c2: r_q has that too.
// `condyn_pin/constraints/partials/motion.py` and `rows.py` derive each.
#pragma once
#include "columns.hpp"
#include "rows.hpp"

namespace condyn
{
/// All six rows by one coordinate, of which a constraint selects its own.
struct RowPartials
{
  Vector6d J, s_q, s_v, c_q, v_q;
  Vector6d w1, w2; // how its wrenches on the two bodies turn, both as the columns of the ends see them

  RowPartials() : J(Vector6d::Zero()), s_q(J), s_v(J), c_q(J), v_q(J), w1(J), w2(J) {}
};

/// The partials of one constraint at a state: made once, asked for each coordinate.
class Linearised
{
public:
  /// `lam`, in its first entries, acts on body 1, in the axes of c1; after `computeRNEADerivatives`.
  Linearised(const Constraint & k, const Data & data, const Vector6d & lam)
  : k_(k), data_(data), E1_(data.oMi[k.joint1] * k.placement1), E2_(data.oMi[k.joint2] * k.placement2)
  , between_(E1_.actInv(E2_)), R_(between_.rotation()), r_(between_.translation())
  , seen2_(k.kind == Kind::weld ? E1_ : SE3(E1_.rotation(), E2_.translation()))
  , one_(data, k.joint1, E1_), two_(data, k.joint2, seen2_)
  {
    for (int i = 0; i < k.size; ++i)
      if (k.kind != Kind::rod)
        force_[k.selection[i]] = lam[i];
    length_ = lam[0];
    if (k.is_cross())
      square_ = force_[3], force_.tail<3>() = square_ * Cross(k, R_).w;
    const bool turns = k.anchored && (k.kind == Kind::weld || (k.kind == Kind::held && !k.is_point()));
    if (turns)
      pinocchio::Jlog6(between_, log_);
    else if (k.anchored && k.kind == Kind::cut && k.is_slider)
      pinocchio::Jlog3(R_, log3_);
  }

  /// What coordinate j does to the velocities of both ends.
  Vector6d J1(int j, bool moves) const { return J_at(E1_, j, moves); }
  Vector6d J2(int j, bool moves) const { return J_at(seen2_, j, moves); }

  /// Columns of coordinate j at both ends, zero at one that it does not move.
  Column at1(int j, bool moves) const { return moves ? column(data_, j, E1_, one_.v) : nothing(); }
  Column at2(int j, bool moves) const { return moves ? column(data_, j, seen2_, two_.v) : nothing(); }

  /// The same without accelerations, for what needs `v_q` alone.
  Column slip1(int j, bool moves) const { return moves ? slip_column(data_, j, E1_) : nothing(); }
  Column slip2(int j, bool moves) const { return moves ? slip_column(data_, j, seen2_) : nothing(); }

  RowPartials operator()(const Column & one, const Column & two) const
  {
    switch (k_.kind)
    {
    case Kind::held: return held(one);
    case Kind::ball: return ball(one, two);
    case Kind::weld: return weld(one, two);
    case Kind::cut: return cut(one, two);
    case Kind::rod: return rod(one, two);
    case Kind::roll: return roll(one);
    default: return {};
    }
  }

private:
  Vector6d J_at(const SE3 & from, int j, bool moves) const
  {
    return moves ? seen(data_.J, j, from).toVector() : Vector6d(Vector6d::Zero());
  }

  RowPartials held(const Column & one) const
  {
    RowPartials of;
    of.J = one.J.toVector(), of.s_q = one.a_q.toVector(), of.s_v = one.a_v.toVector();
    of.v_q = one.v_q.toVector();
    if (k_.is_point())
    {
      of.s_q.head<3>() = one_.classical_q(one), of.s_v.head<3>() = one_.classical_v(one);
      if (k_.anchored)
        of.c_q.head<3>() = one.J.linear() - r_.cross(one.J.angular());
    }
    else if (k_.anchored)
      of.c_q = log_ * between_.actInv(one.J).toVector();
    return of;
  }

  RowPartials ball(const Column & one, const Column & two) const
  {
    RowPartials of;
    const Vector3d turn = one.J.angular() - two.J.angular();
    of.J.head<3>() = one.J.linear() - two.J.linear();
    of.s_q.head<3>() = one_.classical_q(one) - two_.classical().cross(turn) - two_.classical_q(two);
    of.s_v.head<3>() = one_.classical_v(one) - two_.classical_v(two);
    of.c_q.head<3>() = of.J.head<3>() - r_.cross(one.J.angular());
    of.v_q.head<3>() = one.v_q.linear() - two_.v.linear().cross(turn) - two.v_q.linear();
    of.w2.head<3>() = -force_.head<3>().cross(turn);
    return of;
  }

  RowPartials weld(const Column & one, const Column & two) const
  {
    RowPartials of;
    const Motion J = one.J - two.J, slip = one_.v - two_.v;
    const Motion v2_q = two_.v.cross(J) + two.v_q;
    of.J = J.toVector();
    of.s_q = (one.a_q - two_.a.cross(J) - two.a_q + slip.cross(v2_q) - two_.v.cross(one.v_q - v2_q)).toVector();
    of.s_v = (one.a_v - two.a_v + slip.cross(two.J) - two_.v.cross(J)).toVector();
    of.c_q = k_.anchored ? Vector6d(log_ * between_.actInv(J).toVector()) : Vector6d(Vector6d::Zero());
    of.v_q = (one.v_q - v2_q).toVector();
    of.w2 = J.cross(Force(force_)).toVector();
    return of;
  }

  /// The linear slip at c2, of cut joints and rods.
  struct Shift
  {
    Vector3d dr, slip_q, s_q, s_v;
  };

  Vector3d slip() const { return one_.v.linear() - two_.v.linear() + one_.v.angular().cross(r_); }

  Vector3d slip_rate() const
  {
    const Vector3d y = one_.v.angular().cross(r_) - 2 * slip();
    return one_.classical() - two_.classical() + one_.a.angular().cross(r_) + one_.v.angular().cross(y);
  }

  Shift shift(const Column & one, const Column & two) const
  {
    Shift of;
    const Vector3d w1 = one_.v.angular(), turn = one.J.angular() - two.J.angular();
    of.dr = r_.cross(one.J.angular()) + two.J.linear() - one.J.linear();
    const Vector3d swung = w1.cross(of.dr) - r_.cross(one.v_q.angular());
    of.slip_q = one.v_q.linear() - two_.v.linear().cross(turn) - two.v_q.linear() + swung;
    const Vector3d y = w1.cross(r_) - 2 * slip();
    const Vector3d y_q = swung - 2 * of.slip_q, y_v = 2 * of.dr - r_.cross(one.J.angular());
    of.s_q = one_.classical_q(one) - two_.classical().cross(turn) - two_.classical_q(two)
      + one_.a.angular().cross(of.dr) - r_.cross(one.a_q.angular()) + w1.cross(y_q) - y.cross(one.v_q.angular());
    of.s_v = one_.classical_v(one) - two_.classical_v(two) - r_.cross(one.a_v.angular()) + w1.cross(y_v)
      - y.cross(one.J.angular());
    return of;
  }

  RowPartials cut(const Column & one, const Column & two) const
  {
    RowPartials of;
    const Shift lin = shift(one, two);
    const Vector3d w1 = one_.v.angular(), w2 = two_.v.angular(), turn = one.J.angular() - two.J.angular();
    of.J << -lin.dr, turn;
    of.s_q.head<3>() = lin.s_q, of.s_v.head<3>() = lin.s_v;
    of.s_q.tail<3>() = one.a_q.angular() - two_.a.angular().cross(turn) - two.a_q.angular()
      + w1.cross(w2.cross(turn) + two.v_q.angular()) - w2.cross(one.v_q.angular());
    of.s_v.tail<3>() = one.a_v.angular() - two.a_v.angular() + w1.cross(two.J.angular()) - w2.cross(one.J.angular());
    of.v_q << lin.slip_q, one.v_q.angular() - w2.cross(turn) - two.v_q.angular();
    if (k_.anchored)
      of.c_q << -lin.dr, turned(turn);
    of.w1.tail<3>() = -force_.head<3>().cross(lin.dr);
    of.w2 << -force_.head<3>().cross(turn), -force_.tail<3>().cross(turn);
    if (k_.is_cross())
      square(turn, of);
    return of;
  }

  /// The row of a cross in the place of its turns, w . s'_ang + w' . s_ang.
  void square(const Vector3d & turn, RowPartials & of) const
  {
    const Cross at(k_, R_);
    const Vector3d s = one_.v.angular() - two_.v.angular(), w_q = at.rate(turn), s_q = of.v_q.tail<3>();
    const Vector3d s_dot = one_.a.angular() - two_.a.angular() + one_.v.angular().cross(two_.v.angular());
    const Vector3d rate = at.rate(s), rate_q = at.e.cross(at.u.cross(turn).cross(s) + at.u.cross(s_q));
    of.s_q[3] = w_q.dot(s_dot) + at.w.dot(of.s_q.tail<3>()) + rate_q.dot(s) + rate.dot(s_q);
    of.s_v[3] = at.w.dot(of.s_v.tail<3>()) + w_q.dot(s) + rate.dot(turn);
    of.v_q[3] = w_q.dot(s) + at.w.dot(s_q);
    of.J[3] = at.w.dot(turn);
    if (k_.anchored)
      of.c_q[3] = of.J[3];
    of.w1.tail<3>() += square_ * w_q, of.w2.tail<3>() += square_ * w_q;
  }

  /// How the turn that is missing changes, of hinges and sliders.
  Vector3d turned(const Vector3d & turn) const
  {
    if (k_.is_slider)
      return log3_ * (R_.transpose() * turn);
    if (!k_.is_hinge)
      return Vector3d::Zero();
    const Vector3d e = Vector3d::Unit(k_.axis), u = R_ * e, across = u.cross(e);
    const double cosine = u.dot(e), sine = across.norm(), angle = std::atan2(sine, cosine);
    const double scale = sine > 0 ? angle / sine : 1.0;
    const double bend = angle < 1e-4 ? 1.0 / 3 : (1 - angle * cosine / sine) / (sine * sine); // 1e-4: the series
    const Vector3d u_q = u.cross(turn);
    return -scale * e.cross(u_q) - bend * across * e.dot(u_q);
  }

  RowPartials rod(const Column & one, const Column & two) const
  {
    RowPartials of;
    const Shift lin = shift(one, two);
    const double distance = r_.norm();
    const Vector3d n = r_ / distance, n_q = (lin.dr - n * n.dot(lin.dr)) / distance, s = slip();
    const double along = n.dot(s), along_q = n.dot(lin.slip_q) + s.dot(n_q), across = s.dot(s) - along * along;
    of.J[0] = -n.dot(lin.dr);
    of.s_q[0] = n.dot(lin.s_q) + slip_rate().dot(n_q) + across / (distance * distance) * n.dot(lin.dr)
      - 2 * (s.dot(lin.slip_q) - along * along_q) / distance;
    of.s_v[0] = n.dot(lin.s_v) - 2 * (-s.dot(lin.dr) + along * n.dot(lin.dr)) / distance;
    of.c_q[0] = -n.dot(lin.dr);
    of.v_q[0] = along_q;
    const Vector3d F_q = length_ * n_q;
    of.w1 << F_q, r_.cross(F_q) - length_ * n.cross(lin.dr);
    of.w2.head<3>() = F_q - length_ * n.cross(one.J.angular() - two.J.angular());
    return of;
  }

  RowPartials roll(const Column & one) const
  {
    RowPartials of;
    const Vector3d w = one_.v.angular(), alpha = one_.a.angular(), J_w = one.J.angular(), w_q = one.v_q.angular();
    const Touch at(k_, R_, w, J_w, w_q);
    const Turning & r = at.r;
    const Vector3d s = one_.v.linear() + w.cross(r.x);
    const Vector3d rate = one_.a.linear() + alpha.cross(r.x) + w.cross(r.dot);
    const Vector3d s_q = one.v_q.linear() - r.x.cross(w_q) + w.cross(r.x_q);
    const Vector3d s_v = one.J.linear() - r.x.cross(J_w);
    const Vector3d rate_q = one.a_q.linear() - r.x.cross(one.a_q.angular()) + alpha.cross(r.x_q) + w.cross(r.dot_q)
      - r.dot.cross(w_q);
    const Vector3d rate_v = one.a_v.linear() - r.x.cross(one.a_v.angular()) + w.cross(r.x_q) - r.dot.cross(J_w);
    Vector3d force_q = Vector3d::Zero();
    for (int i = 0; i < 3; ++i)
    {
      const Turning & t = at.axes[i];
      of.J[i] = t.x.dot(s_v);
      of.s_q[i] = t.x.dot(rate_q) + rate.dot(t.x_q) + t.dot.dot(s_q) + s.dot(t.dot_q);
      of.s_v[i] = t.x.dot(rate_v) + t.dot.dot(s_v) + s.dot(t.x_q);
      of.v_q[i] = t.x.dot(s_q) + s.dot(t.x_q);
      force_q += force_[i] * t.x_q;
    }
    if (k_.anchored)
      of.c_q[2] = of.J[2]; // the rate of the gap
    of.w1 << force_q, r.x.cross(force_q) - at.force(force_).cross(r.x_q);
    return of;
  }

  const Constraint & k_;
  const Data & data_;
  SE3 E1_, E2_, between_;
  Matrix3d R_;
  Vector3d r_;
  SE3 seen2_; // where the motion of body 2 is taken: at c2, and for a weld at c1; in the axes of c1
  Body one_, two_;
  Vector6d force_ = Vector6d::Zero();
  double length_; // the force of a rod
  double square_ = 0; // of a cross: what holds its pins across each other
  Eigen::Matrix<double, 6, 6> log_;
  Matrix3d log3_;
};
} // namespace condyn
