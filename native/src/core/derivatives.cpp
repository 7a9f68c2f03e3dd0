#include "derivatives.hpp"
#include <pinocchio/algorithm/kinematics.hpp>
#include <pinocchio/algorithm/rnea-derivatives.hpp>

namespace condyn
{
Derivatives::Derivatives(const Scene & scene)
: scene_(scene), data_(scene.model), on_joint_(scene.model.njoints, Force::Zero()), factors_(scene)
{
  for (const auto & k : scene.constraints)
    moved_.emplace_back(scene.model, k);
}

bool Derivatives::operator()(
  const VectorXd & q, const VectorXd & v, const VectorXd & a, const VectorXd & lam, const Loads & loads,
  const Data & placed, double * const out[6])
{
  const int n = scene_.model.nv, m = scene_.rows;
  linearise(q, v, a, lam, loads, placed);
  if (!factors_.factorise(data_.M, J_))
    return false;
  MatrixXd da = rhs_.topRows(n), dlam = factors_.solve(da, rhs_.bottomLeftCorner(m, 2 * n));
  if (factors_.dependent())
    dlam.leftCols(n) += along_redundant_rows(q, lam);
  for (int k = 0; k < 3; ++k)
  {
    Eigen::Map<RowMajor>(out[k], n, n) = da.middleCols(k * n, n);
    if (m)
      Eigen::Map<RowMajor>(out[3 + k], m, n) = dlam.middleCols(k * n, n);
  }
  return da.allFinite() && dlam.allFinite();
}

void Derivatives::linearise(
  const VectorXd & q, const VectorXd & v, const VectorXd & a, const VectorXd & lam, const Loads & loads,
  const Data & placed)
{
  const int n = scene_.model.nv, m = scene_.rows;
  on_joint_ = loads.on_joint;
  VectorXd of_couplings = VectorXd::Zero(n); // J^T lam that does not change
  add_wrenches(scene_, placed, lam, on_joint_, of_couplings);
  pinocchio::computeRNEADerivatives(scene_.model, data_, q, v, a, on_joint_);
  rhs_.setZero(n + m, 3 * n), J_.setZero(m, n);
  rhs_.topLeftCorner(n, n) = -data_.dtau_dq, rhs_.block(0, n, n, n) = -data_.dtau_dv;
  rhs_.topRightCorner(n, n).setIdentity();
  for (std::size_t i = 0; i < scene_.constraints.size(); ++i)
    write(i, lam);
  for (std::size_t i = 0; i < loads.pushes.size(); ++i)
    if (loads.pushes[i].in_world)
      turn(loads.pushes[i], loads.wrenches[i]);
}

/// Adds what turns of J_f^T f to -r_q, for a force that is fixed in the world: x_q = x x J_w for both its parts.
void Derivatives::turn(const Push & push, const Vector6d & wrench)
{
  const SE3 E = data_.oMi[push.joint] * push.placement;
  std::vector<int> columns;
  for (auto above : scene_.model.supports[push.joint])
    for (int j = scene_.model.idx_vs[above]; above && j < scene_.model.idx_vs[above] + scene_.model.nvs[above]; ++j)
      columns.push_back(j);
  Matrix6x J(6, columns.size()), turned(6, columns.size());
  for (std::size_t c = 0; c < columns.size(); ++c)
  {
    J.col(c) = E.actInv(Motion(data_.J.col(columns[c]).head<3>(), data_.J.col(columns[c]).tail<3>())).toVector();
    const Vector3d J_w = J.col(c).tail<3>();
    turned.col(c) << wrench.head<3>().cross(J_w), wrench.tail<3>().cross(J_w);
  }
  const MatrixXd by = J.transpose() * turned;
  for (std::size_t c = 0; c < columns.size(); ++c)
    for (std::size_t b = 0; b < columns.size(); ++b)
      rhs_(columns[b], columns[c]) += by(b, c);
}

/// Writes the rows of a constraint into J and -[s_q, s_v], and adds what turns of J^T lam to -r_q.
void Derivatives::write(std::size_t i, const VectorXd & lam)
{
  const Constraint & k = scene_.constraints[i];
  const int n = scene_.model.nv;
  const double kp = scene_.kp, kd = scene_.kd;
  if (k.kind == Kind::coupling)
  {
    write_coupling(k, J_.row(k.first));
    rhs_.row(n + k.first).head(n) = -kp * J_.row(k.first);
    rhs_.row(n + k.first).segment(n, n) = -kd * J_.row(k.first);
    return;
  }
  const Linearised of(k, data_, k.sign * lam.segment(k.first, k.size));
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
      J_(to, j) = k.sign * by.J[from];
      rhs_(n + to, j) = -k.sign * (by.s_q[from] + kp * by.c_q[from] + kd * by.v_q[from]);
      rhs_(n + to, n + j) = -k.sign * (by.s_v[from] + kd * by.J[from]);
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
      rhs_(columns[b], columns[c]) += turned(b, c);
}

/// What keeps lam the smallest as the rows turn.
MatrixXd Derivatives::along_redundant_rows(const VectorXd & q, const VectorXd & lam)
{
  // lam = J w, with the smallest w in the metric of M
  VectorXd w = factors_.Q * (factors_.B_inverse * lam);
  factors_.L.triangularView<Eigen::Lower>().transpose().solveInPlace(w);
  const MatrixXd turned = turning(q, w);
  return turned - factors_.Q2 * (factors_.Q2.transpose() * turned);
}

/// How J w changes with q while w stays: as the slip does at v = w.
MatrixXd Derivatives::turning(const VectorXd & q, const VectorXd & w)
{
  const Model & model = scene_.model;
  pinocchio::forwardKinematics(model, data_, q, w);
  data_.ov[0].setZero();
  for (int i = 1; i < model.njoints; ++i)
  {
    data_.ov[i] = data_.oMi[i].act(data_.v[i]);
    for (int j = model.idx_vs[i]; j < model.idx_vs[i] + model.nvs[i]; ++j)
    {
      const Motion moved = data_.ov[model.parents[i]].cross(Motion(data_.J.col(j).head<3>(), data_.J.col(j).tail<3>()));
      data_.dVdq.col(j) = moved.toVector();
    }
  }
  MatrixXd turned = MatrixXd::Zero(scene_.rows, model.nv);
  for (std::size_t i = 0; i < scene_.constraints.size(); ++i)
  {
    const Constraint & k = scene_.constraints[i];
    if (k.kind == Kind::coupling)
      continue;
    const Linearised of(k, data_, VectorXd::Zero(k.size));
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
