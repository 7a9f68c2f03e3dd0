#include "contact_turning.hpp"

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
  for (const auto & touch : candidates.touches)
  {
    const auto body = above(touch.joint), ground = above(touch.ground);
    movers_.emplace_back();
    for (int j = 0; j < model.nv; ++j)
      if (body[j] || ground[j])
        movers_.back().push_back({j, bool(body[j]), bool(ground[j])});
  }
}

std::vector<int> ContactTurning::columns(int point) const
{
  std::vector<int> found;
  for (const Mover & mover : movers_[point])
    found.push_back(mover.column);
  return found;
}

void ContactTurning::go(const Data & data, const std::vector<int> & points)
{
  S_ = data.J;
  now_.clear();
  for (int i : points)
  {
    const ContactPoint & touch = candidates_.touches[i];
    const Candidates::Place at = Candidates::place(touch, data);
    const Vector3d radial = touch.radius * at.E.col(2);
    now_.push_back({touch.joint, touch.ground, at.E.transpose(), at.point, at.point + radial, radial, &movers_[i]});
  }
}

/// With V_0 the velocity of what carries the joint of a coordinate, v_P and w_b those of the body at P and its
/// turning, and w_g that of the ground, a coordinate that moves one of the two has
///
///   d . (V_0l' - P x V_0a' - v_P x S_a - w_b x (radius n x S_a) - w_g x (S_l + S_a x p)),    V_0' = V_0 x S
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
    const Vector3d w_b = twists_[t.joint].tail<3>(), w_g = twists_[t.ground].tail<3>();
    const Vector3d v_P = twists_[t.joint].head<3>() + w_b.cross(t.P);
    for (const Mover & mover : *t.movers)
    {
      if (mover.body == mover.ground)
        continue;
      const Vector3d S_l = S_.col(mover.column).head<3>(), S_a = S_.col(mover.column).tail<3>();
      const auto & V_0 = twists_[model_.parents[joint_of_[mover.column]]];
      const Vector3d carried_a = V_0.tail<3>().cross(S_a);
      const Vector3d carried_l = V_0.tail<3>().cross(S_l) + V_0.head<3>().cross(S_a);
      const Vector3d turned = carried_l + carried_a.cross(t.P) - v_P.cross(S_a) - w_b.cross(t.radial.cross(S_a))
        - w_g.cross(Vector3d(S_l + S_a.cross(t.p)));
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
      Vector3d P_moved = Vector3d::Zero(), f_turned = P_moved;
      if (by.body)
        P_moved += S_l + S_a.cross(t.p);
      if (by.ground)
        P_moved += t.radial.cross(S_a), f_turned = S_a.cross(f);
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
