#include "contact_turning.hpp"
#include <algorithm>

namespace condyn
{
ContactTurning::ContactTurning(const Model & model, const Candidates & candidates)
: model_(model), candidates_(candidates), joint_of_(model.nv), twists_(model.njoints)
{
  for (int i = 1; i < model.njoints; ++i)
    for (int k = 0; k < model.nvs[i]; ++k)
      joint_of_[model.idx_vs[i] + k] = i;
  const auto above = [&](int joint) {
    std::vector<char> moved(model.nv, 0);
    for (auto i : model.supports[joint])
      for (int k = 0; i && k < model.nvs[i]; ++k)
        moved[model.idx_vs[i] + k] = 1;
    return moved;
  };
  for (int i = 0; i < candidates.cones(); ++i)
  {
    const auto body = above(candidates.sides(i).first), ground = above(candidates.sides(i).second);
    movers_.emplace_back();
    for (int j = 0; j < model.nv; ++j)
      if (body[j] || ground[j])
        movers_.back().push_back({j, bool(body[j]), bool(ground[j])});
  }
}

std::vector<int> ContactTurning::columns(int cone) const
{
  std::vector<int> found;
  for (const Mover & mover : movers_[cone])
    found.push_back(mover.column);
  return found;
}

bool ContactTurning::go(const Data & data, const std::vector<int> & cones)
{
  S_ = data.J;
  now_.clear();
  for (int i : cones)
  {
    if (i >= candidates_.over_planes())
      break;
    const ContactPoint & touch = candidates_.touches[i];
    const Candidates::Place at = Candidates::place(touch, data);
    const Vector3d middle = at.point + touch.radius * at.E.col(2);
    now_.push_back({touch.joint, touch.ground, at.E.transpose(), at.point, middle, touch.radius, false, {},
                    &movers_[i]});
  }
  int first = candidates_.over_planes();
  for (const Pair & pair : candidates_.pairs)
  {
    if (!meet(first, pair, data, cones))
      return false;
    first += pair.places();
  }
  return true;
}

/// Adds those of the cones, the first one of a pair given, where its shapes meet; false where one has no derivative.
bool ContactTurning::meet(int first, const Pair & pair, const Data & data, const std::vector<int> & cones)
{
  const SE3 one = pair.one(data), two = pair.two(data);
  const bool are_balls = pair.are_balls(one, two);
  const Shape A = pair.shape.placed(one), B = pair.ground_shape.placed(two);
  const double radius = are_balls ? A.reach : A.radius, other = are_balls ? B.reach : B.radius;
  int cone = first;
  for (const Meeting & at : pair.meet(data))
  {
    const Vector3d a = at.point + radius * at.normal;
    const double between = at.gap + radius + other;
    const auto how = are_balls ? of_balls(at.normal, between) : sliding(A, B, a, at.normal, between);
    if (!how)
      return false;
    if (std::binary_search(cones.begin(), cones.end(), cone))
      now_.push_back({pair.joint, pair.ground, Candidates::place(at).E.transpose(), at.point, a, radius, true, *how,
                      &movers_[cone]});
    ++cone;
  }
  return true;
}

ContactTurning::Rates ContactTurning::Touching::by_body(const Vector3d & linear, const Vector3d & angular) const
{
  const Vector3d v_a = linear + angular.cross(a);
  if (!slides)
    return {v_a, Vector3d::Zero()};
  const Vector3d n = d.row(2), turned = how.U * angular.cross(n) + how.R * v_a;
  return {v_a - how.U.transpose() * (v_a - how.between * turned) - radius * turned, n.cross(turned)};
}

/// With V_0, V_b and V_g the twists of what carries the joint of a coordinate, of the body and of the ground, and all
/// of it seen from what the ground does, a coordinate that moves one of the two has
///
///   d . (V_l' + V_a' x P + V_a x P' - (n x n') x (V_l + V_a x P)),    V = V_b - V_g,    V' = (V_0 - V_b) x S
void ContactTurning::slips(const VectorXd & w, MatrixXd & by_q)
{
  twists_[0].setZero();
  for (int i = 1; i < model_.njoints; ++i)
    twists_[i] = twists_[model_.parents[i]]
      + S_.middleCols(model_.idx_vs[i], model_.nvs[i]) * w.segment(model_.idx_vs[i], model_.nvs[i]);
  by_q.setZero(3 * now_.size(), model_.nv);
  for (std::size_t i = 0; i < now_.size(); ++i)
  {
    const Touching & t = now_[i];
    const Vector6d V = twists_[t.joint] - twists_[t.ground];
    const Vector3d V_a = V.tail<3>(), slip = V.head<3>() + V_a.cross(t.P);
    for (const Mover & mover : *t.movers)
    {
      if (mover.body == mover.ground)
        continue;
      const Vector3d S_l = S_.col(mover.column).head<3>(), S_a = S_.col(mover.column).tail<3>();
      const Vector6d off = twists_[model_.parents[joint_of_[mover.column]]] - twists_[t.joint];
      const Vector3d off_l = off.head<3>(), off_a = off.tail<3>();
      const Vector3d carried_l = off_a.cross(S_l) + off_l.cross(S_a), carried_a = off_a.cross(S_a);
      const Rates moved = t.by_body(S_l, S_a);
      const Vector3d turned = carried_l + carried_a.cross(t.P) + V_a.cross(moved.P) + slip.cross(moved.axes);
      by_q.block<3, 1>(3 * i, mover.column).noalias() = mover.moves() * (t.d * turned);
    }
  }
}

/// Column i feels F_i, the wrench of all that it moves: with S_i' = S_j x S_i that is (S_i x* F_i) . S_j, and
/// F' = (f', P' x f + P x f') comes on top.
void ContactTurning::pulls(const VectorXd & lam, Eigen::Ref<MatrixXd> by_q) const
{
  Matrix6x felt = Matrix6x::Zero(6, model_.nv); // force, then moment
  for (std::size_t i = 0; i < now_.size(); ++i)
  {
    const Touching & t = now_[i];
    const Vector3d f = t.d.transpose() * lam.segment<3>(3 * i), moment = t.P.cross(f);
    if (f.isZero(0))
      continue;
    for (const Mover & by : *t.movers)
    {
      const Vector3d S_l = S_.col(by.column).head<3>(), S_a = S_.col(by.column).tail<3>();
      felt.col(by.column).head<3>() += by.moves() * f, felt.col(by.column).tail<3>() += by.moves() * moment;
      Vector3d P_moved = Vector3d::Zero(), axes_moved = P_moved;
      if (by.body != by.ground)
      {
        const Rates moved = t.by_body(S_l, S_a);
        P_moved = by.moves() * moved.P, axes_moved = by.moves() * moved.axes;
      }
      if (by.ground)
        P_moved += S_l + S_a.cross(t.P), axes_moved += S_a;
      const Vector3d f_turned = axes_moved.cross(f);
      const Vector3d turned = P_moved.cross(f) + t.P.cross(f_turned);
      for (const Mover & on : *t.movers)
        if (on.body != on.ground)
          by_q(on.column, by.column) += on.moves()
            * (S_.col(on.column).tail<3>().dot(turned) + S_.col(on.column).head<3>().dot(f_turned));
    }
  }
  for (int i = 0; i < model_.nv; ++i)
  {
    if (felt.col(i).isZero(0))
      continue;
    const Vector3d S_l = S_.col(i).head<3>(), S_a = S_.col(i).tail<3>();
    const Vector3d f = felt.col(i).head<3>(), force = S_a.cross(f);
    const Vector3d moment = S_a.cross(Vector3d(felt.col(i).tail<3>())) + S_l.cross(f);
    for (auto above : model_.supports[joint_of_[i]])
      for (int k = 0; above && k < model_.nvs[above]; ++k)
      {
        const int j = model_.idx_vs[above] + k;
        by_q(i, j) += force.dot(S_.col(j).head<3>()) + moment.dot(S_.col(j).tail<3>());
      }
  }
}
} // namespace condyn
