#include "linearisation.hpp"
#include "partials.hpp"
#include <pinocchio/algorithm/kinematics.hpp>
#include <pinocchio/algorithm/rnea-derivatives.hpp>

namespace condyn
{
Linearisation::Linearisation(const Scene & scene)
: data(scene.model), scene_(scene), on_joint_(scene.model.njoints, Force::Zero())
{
  for (const auto & k : scene.constraints)
    moved_.emplace_back(scene.model, k);
}

void Linearisation::at(
  const VectorXd & q, const VectorXd & v, const VectorXd & a, const VectorXd & lam, const Loads & loads,
  const Data & placed)
{
  const int n = scene_.model.nv, m = scene_.rows;
  on_joint_ = loads.on_joint;
  VectorXd of_couplings = VectorXd::Zero(n); // J^T lam that does not change
  add_wrenches(scene_, placed, lam, on_joint_, of_couplings);
  pinocchio::computeRNEADerivatives(scene_.model, data, q, v, a, on_joint_);
  r.resize(n, 2 * n), s.setZero(m, 2 * n), J.setZero(m, n);
  r.leftCols(n) = -data.dtau_dq, r.rightCols(n) = -data.dtau_dv;
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
      r(columns[b], columns[c]) += by(b, c);
}

/// Writes the rows of a constraint into J and -[s_q, s_v], and adds what turns of J^T lam to -r_q.
void Linearisation::write(std::size_t i, const VectorXd & lam)
{
  const Constraint & k = scene_.constraints[i];
  const int n = scene_.model.nv;
  const double kp = scene_.kp, kd = scene_.kd;
  if (k.kind == Kind::coupling)
  {
    write_coupling(k, J.row(k.first));
    s.row(k.first).head(n) = -kp * J.row(k.first);
    s.row(k.first).tail(n) = -kd * J.row(k.first);
    return;
  }
  const Linearised of(k, data, k.sign * lam.segment(k.first, k.size));
  const auto & columns = moved_[i].columns;
  const int count = int(columns.size());
  Matrix6x J1(6, count), J2(6, count), w1(6, count), w2(6, count);
  for (int c = 0; c < count; ++c)
  {
    const int j = columns[c];
    const Column one = of.at1(j, moved_[i].one[c]), two = of.at2(j, moved_[i].two[c]);
    const RowPartials by = of(one, two);
    for (int row = 0; row < k.size; ++row)
    {
      const int from = k.component(row), to = k.first + row;
      J(to, j) = k.sign * by.J[from];
      s(to, j) = -k.sign * (by.s_q[from] + kp * by.c_q[from] + kd * by.v_q[from]);
      s(to, n + j) = -k.sign * (by.s_v[from] + kd * by.J[from]);
    }
    J1.col(c) = one.J.toVector(), J2.col(c) = two.J.toVector();
    w1.col(c) = by.w1, w2.col(c) = by.w2;
  }
  if (k.kind == Kind::held)
    return;
  MatrixXd turned(count, count);
  turned.noalias() = -J2.transpose() * w2;
  if (k.kind != Kind::ball && k.kind != Kind::weld)
    turned.noalias() += J1.transpose() * w1;
  for (int c = 0; c < count; ++c)
    for (int b = 0; b < count; ++b)
      r(columns[b], columns[c]) += turned(b, c);
}

/// How J w changes with q while w stays: as the slip does at v = w.
MatrixXd Linearisation::turning(const VectorXd & q, const VectorXd & w)
{
  const Model & model = scene_.model;
  pinocchio::forwardKinematics(model, data, q, w);
  data.ov[0].setZero();
  for (int i = 1; i < model.njoints; ++i)
  {
    data.ov[i] = data.oMi[i].act(data.v[i]);
    for (int j = model.idx_vs[i]; j < model.idx_vs[i] + model.nvs[i]; ++j)
    {
      const Motion moved = data.ov[model.parents[i]].cross(Motion(data.J.col(j).head<3>(), data.J.col(j).tail<3>()));
      data.dVdq.col(j) = moved.toVector();
    }
  }
  MatrixXd turned = MatrixXd::Zero(scene_.rows, model.nv);
  for (std::size_t i = 0; i < scene_.constraints.size(); ++i)
  {
    const Constraint & k = scene_.constraints[i];
    if (k.kind == Kind::coupling)
      continue;
    const Linearised of(k, data, VectorXd::Zero(k.size));
    for (std::size_t c = 0; c < moved_[i].columns.size(); ++c)
    {
      const int j = moved_[i].columns[c];
      const RowPartials by = of(of.slip1(j, moved_[i].one[c]), of.slip2(j, moved_[i].two[c]));
      for (int row = 0; row < k.size; ++row)
        turned(k.first + row, j) = k.sign * by.v_q[k.component(row)];
    }
  }
  return turned;
}
} // namespace condyn
