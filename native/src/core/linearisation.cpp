#include "linearisation.hpp"
#include "partials.hpp"
#include <pinocchio/algorithm/kinematics.hpp>
#include <pinocchio/algorithm/rnea-derivatives.hpp>

namespace condyn
{
Linearisation::Linearisation(const Scene & scene)
: data(scene.model), scene_(scene), on_joint_(scene.model.njoints, Force::Zero()), J1_(6, scene.model.nv), J2_(J1_)
, w1_(J1_), w2_(J1_)
{
  for (const auto & k : scene.constraints)
    moved_.emplace_back(scene.model, k);
}

/// Where `asked` may not be zero.
Carried Linearisation::touched() const
{
  Carried found(scene_.model, scene_.rows);
  for (std::size_t i = 0; i < scene_.constraints.size(); ++i)
  {
    const Constraint & k = scene_.constraints[i];
    const auto & moved = moved_[i];
    found.tie(moved.columns);
    for (std::size_t c = 0; c < moved.columns.size(); ++c)
      if (moved.slips(c, k))
        found.change(moved.columns[c], k.first, k.size);
    if (k.kind == Kind::coupling)
      for (int j : {k.v_a, k.v_b})
        found.change(j, k.first, 1);
  }
  return found;
}

void Linearisation::at(
  const VectorXd & q, const VectorXd & v, const VectorXd & a, const VectorXd & lam, const Loads & loads,
  const Data & placed)
{
  const int n = scene_.model.nv, m = scene_.rows;
  on_joint_ = loads.on_joint;
  of_couplings_.setZero(n);
  add_wrenches(scene_, placed, lam, on_joint_, of_couplings_);
  pinocchio::computeRNEADerivatives(scene_.model, data, q, v, a, on_joint_);
  asked.resize(n + m, 2 * n), J.setZero(m, n);
  asked.topLeftCorner(n, n) = -data.dtau_dq, asked.topRightCorner(n, n) = -data.dtau_dv;
  asked.bottomRows(m).setZero();
  for (std::size_t i = 0; i < scene_.constraints.size(); ++i)
    write(i, lam);
  for (std::size_t i = 0; i < loads.pushes.size(); ++i)
    if (loads.pushes[i].in_world)
      turn(loads.pushes[i], loads.wrenches[i]);
}

/// Adds what turns of J_f^T f to -r_q, for a force that is fixed in the world: x_q = x x J_w for both its parts.
void Linearisation::turn(const Push & push, const Vector6d & wrench)
{
  const SE3 E = data.oMi[push.joint] * push.placement;
  std::vector<int> columns;
  for (auto above : scene_.model.supports[push.joint])
    for (int j = scene_.model.idx_vs[above]; above && j < scene_.model.idx_vs[above] + scene_.model.nvs[above]; ++j)
      columns.push_back(j);
  Matrix6x J(6, columns.size()), turned(6, columns.size());
  for (std::size_t c = 0; c < columns.size(); ++c)
  {
    J.col(c) = E.actInv(Motion(data.J.col(columns[c]).head<3>(), data.J.col(columns[c]).tail<3>())).toVector();
    const Vector3d J_w = J.col(c).tail<3>();
    turned.col(c) << wrench.head<3>().cross(J_w), wrench.tail<3>().cross(J_w);
  }
  const MatrixXd by = J.transpose() * turned;
  for (std::size_t c = 0; c < columns.size(); ++c)
    for (std::size_t b = 0; b < columns.size(); ++b)
      asked(columns[b], columns[c]) += by(b, c);
}

/// Writes the rows of a constraint into J and -[s_q, s_v], and adds what turns of J^T lam to -r_q.
void Linearisation::write(std::size_t i, const VectorXd & lam)
{
  const Constraint & k = scene_.constraints[i];
  const Moved & moved = moved_[i];
  const int n = scene_.model.nv;
  const double kp = scene_.kp, kd = scene_.kd;
  auto s = asked.bottomRows(scene_.rows);
  if (k.kind == Kind::coupling)
  {
    write_coupling(k, J.row(k.first));
    s.row(k.first).head(n) = -kp * J.row(k.first);
    s.row(k.first).tail(n) = -kd * J.row(k.first);
    return;
  }
  Vector6d force = Vector6d::Zero();
  force.head(k.size) = k.sign * lam.segment(k.first, k.size);
  const Linearised of(k, data, force);
  for (std::size_t c = 0; c < moved.columns.size(); ++c)
  {
    const int j = moved.columns[c];
    J1_.col(c) = of.J1(j, moved.one[c]), J2_.col(c) = of.J2(j, moved.two[c]);
    if (!moved.slips(c, k))
      continue;
    const RowPartials by = of(of.at1(j, moved.one[c]), of.at2(j, moved.two[c]));
    for (int row = 0; row < k.size; ++row)
    {
      const int from = k.component(row), to = k.first + row;
      J(to, j) = k.sign * by.J[from];
      s(to, j) = -k.sign * (by.s_q[from] + kp * by.c_q[from] + kd * by.v_q[from]);
      s(to, n + j) = -k.sign * (by.s_v[from] + kd * by.J[from]);
    }
    w1_.col(c) = by.w1, w2_.col(c) = by.w2;
  }
  if (k.kind != Kind::held)
    turn_pair(moved, k);
}

/// Adds what turns of the wrenches on the second body, and on the first one, to -r_q.
void Linearisation::turn_pair(const Moved & moved, const Constraint & k)
{
  const int count = int(moved.columns.size());
  const bool both = k.kind != Kind::ball && k.kind != Kind::weld;
  for (int c = 0; c < count; ++c)
  {
    if (!moved.slips(c, k))
      continue;
    auto r_q = asked.col(moved.columns[c]);
    for (int b = 0; b < count; ++b)
    {
      const double second = moved.two[b] ? J2_.col(b).dot(w2_.col(c)) : 0.0;
      const double first = both && moved.one[b] ? J1_.col(b).dot(w1_.col(c)) : 0.0;
      r_q[moved.columns[b]] += first - second;
    }
  }
}

/// How J w changes with q while w stays: as the slip does at v = w.
MatrixXd Linearisation::turning(const VectorXd & w)
{
  const Model & model = scene_.model;
  data.ov[0].setZero();
  for (int i = 1; i < model.njoints; ++i)
  {
    const Motion & parent = data.ov[model.parents[i]];
    data.ov[i] = parent;
    for (int j = model.idx_vs[i]; j < model.idx_vs[i] + model.nvs[i]; ++j)
    {
      const Motion column(data.J.col(j).head<3>(), data.J.col(j).tail<3>());
      data.dVdq.col(j) = parent.cross(column).toVector();
      data.ov[i] += w[j] * column;
    }
  }
  MatrixXd turned = MatrixXd::Zero(scene_.rows, model.nv);
  for (std::size_t i = 0; i < scene_.constraints.size(); ++i)
  {
    const Constraint & k = scene_.constraints[i];
    if (k.kind == Kind::coupling)
      continue;
    const Linearised of(k, data, Vector6d::Zero());
    for (std::size_t c = 0; c < moved_[i].columns.size(); ++c)
    {
      if (!moved_[i].slips(c, k))
        continue;
      const int j = moved_[i].columns[c];
      const RowPartials by = of(of.slip1(j, moved_[i].one[c]), of.slip2(j, moved_[i].two[c]));
      for (int row = 0; row < k.size; ++row)
        turned(k.first + row, j) = k.sign * by.v_q[k.component(row)];
    }
  }
  return turned;
}
} // namespace condyn
