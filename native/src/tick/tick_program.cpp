#include "tick_program.hpp"
#include <algorithm>

namespace condyn
{
namespace
{
template<typename Rows>
void take(const Rows & from, const std::vector<int> & chosen, Eigen::Ref<MatrixXd> to)
{
  for (std::size_t i = 0; i < chosen.size(); ++i)
    to.row(i) = from.row(chosen[i]);
}

/// Columns that are what rounding leaves of others of a size: no way to move. They would take 1e15 m/s^2.
template<typename Columns>
void drop_rounding(Columns && columns, double size, double rank)
{
  for (Eigen::Index i = 0; i < columns.cols(); ++i)
    if (columns.col(i).norm() <= rank * size)
      columns.col(i).setZero();
}
} // namespace

TickProgram::TickProgram(const Scene & scene, const TickSpec & spec)
: scene_(scene), spec_(spec), terms_(scene), tasks_(scene, spec), holds_(!spec.held.empty() || !spec.rigid.empty())
, rows_(MatrixXd::Zero(spec.held.size() + spec.rigid.size(), scene.model.nv)), cones_(spec.cones)
, a_0_(VectorXd::Zero(scene.model.nv))
{
  for (int i = 0; i < scene.model.nv; ++i)
    if (std::find(spec.motors.begin(), spec.motors.end(), i) == spec.motors.end())
      others_.push_back(i);
  for (std::size_t i = 0; i < spec.rigid.size(); ++i)
    rows_(spec.held.size() + i, spec.rigid[i]) = 1.0;
}

bool TickProgram::at(const VectorXd & q, VectorXd v, const VectorXd & passive, const double * numbers)
{
  passive_ = passive;
  terms_.place(q);
  if (scene_.rows && !(terms_.J.squaredNorm() > 10 * spec_.least))
    return false;
  if (holds_ && !(hold() && lock(v)))
    return false;
  terms_.move(v);
  tasks_.at(terms_, numbers);
  eliminate();
  if (!turn_cones())
    return false;
  qp.split = force_.rows();
  write_along();
  if (spec_.levels.size() > 1)
    write_wishes();
  else
    write_objective();
  write_equations();
  write_inequalities();
  return true;
}

bool TickProgram::hold()
{
  take(terms_.J, spec_.held, rows_.topRows(spec_.held.size()));
  if (!elimination_.at(rows_, spec_.motors, spec_.rank))
    return false;
  inertia_ = elimination_.N.transpose() * terms_.M * elimination_.N;
  return true;
}

void TickProgram::eliminate()
{
  const Eigen::Index m = spec_.touching.size();
  const double per_mass = 1.0 / spec_.mass;
  J_c_.resize(m, scene_.model.nv), demanded_.resize(m);
  take(terms_.J, spec_.touching, J_c_);
  for (Eigen::Index i = 0; i < m; ++i)
    demanded_[i] = terms_.wanted[spec_.touching[i]];
  VectorXd h = terms_.h - passive_;
  if (holds_)
  {
    VectorXd r = VectorXd::Zero(rows_.rows());
    for (std::size_t i = 0; i < spec_.held.size(); ++i)
      r[i] = terms_.wanted[spec_.held[i]];
    a_0_ = elimination_.particular(r);
    h += terms_.M * a_0_;
    demanded_ -= J_c_ * a_0_;
    touch_ = J_c_ * elimination_.N;
    h = elimination_.N.transpose() * h;
  }
  else
    touch_ = J_c_;
  drop_rounding(touch_.transpose(), J_c_.norm(), spec_.rank);
  h *= per_mass;
  const Eigen::Index k = touch_.cols();
  force_.resize(k, k + m);
  force_.leftCols(k) = per_mass * (holds_ ? inertia_ : terms_.M);
  force_.rightCols(m) = -touch_.transpose();
  const Eigen::Index motors = spec_.motors.size(), inner = holds_ ? elimination_.inner.cols() : 0;
  torque_.resize(motors, k + m + inner);
  if (holds_)
  {
    torque_.leftCols(k + m) = elimination_.drive * force_, torque_.rightCols(inner) = elimination_.inner;
    law_ = elimination_.unreached * force_;
    torque_0_ = elimination_.drive * h, law_0_ = elimination_.unreached * h;
    return;
  }
  law_.resize(others_.size(), k + m), torque_0_.resize(motors), law_0_.resize(others_.size());
  take(force_, spec_.motors, torque_), take(force_, others_, law_);
  take(h, spec_.motors, torque_0_), take(h, others_, law_0_);
}

void TickProgram::write_along()
{
  along_.resize(qp.split, spec_.task_rows);
  if (holds_)
    along_.noalias() = (tasks_.J * elimination_.N).transpose();
  else
    along_ = tasks_.J.transpose();
}

void TickProgram::write_wishes()
{
  const Eigen::Index n = torque_.cols(), k = qp.split, m = touch_.rows();
  wishes.G.setZero(n, spec_.task_rows), wishes.weights.resize(spec_.task_rows);
  wishes.G.topRows(k) = along_;
  wishes.G.middleRows(k, m) = spec_.mass * tasks_.F.transpose();
  wishes.b = tasks_.b;
  if (holds_)
    wishes.b -= tasks_.J * a_0_;
  for (const auto & task : spec_.tasks)
    wishes.weights.segment(task.first, task.size).setConstant(task.weight);
}

void TickProgram::write_objective()
{
  const Eigen::Index n = torque_.cols(), k = qp.split, m = touch_.rows();
  qp.H.setZero(n, n), qp.g.setZero(n);
  auto H_z = qp.H.topLeftCorner(k, k);
  for (const auto & task : spec_.tasks)
  {
    const double w = task.weight;
    VectorXd b = tasks_.b.segment(task.first, task.size);
    if (task.hard)
      continue;
    if (task.is_force())
    {
      const MatrixXd F = spec_.mass * tasks_.F.middleRows(task.first, task.size);
      qp.H.block(k, k, m, m).selfadjointView<Eigen::Lower>().rankUpdate(F.transpose(), w);
      qp.g.segment(k, m) -= w * (F.transpose() * b);
      continue;
    }
    if (task.is_selection() && !holds_)
    {
      for (int i = 0; i < task.size; ++i)
        H_z(task.columns[i], task.columns[i]) += w, qp.g[task.columns[i]] -= w * b[i];
      continue;
    }
    const auto G = along_.middleCols(task.first, task.size);
    if (holds_)
      b -= tasks_.J.middleRows(task.first, task.size) * a_0_;
    H_z.selfadjointView<Eigen::Lower>().rankUpdate(G, w);
    qp.g.head(k) -= w * (G * b);
  }
  qp.H.diagonal().array() += spec_.regularisation;
}

void TickProgram::write_equations()
{
  const Eigen::Index n = torque_.cols(), k = qp.split, m = touch_.rows(), laws = law_.rows();
  Eigen::Index hard = 0;
  for (const auto & task : spec_.tasks)
    hard += task.hard ? task.size : 0;
  if (contacts_ != independent && m)
  {
    const VectorXd wanted = demanded_;
    const int rank = nearest_reached(touch_, demanded_, spec_.rank);
    if (contacts_ == unknown)
      contacts_ = rank < m ? redundant : independent;
    unreached = largest(demanded_ - wanted);
  }
  qp.A.setZero(n, laws + m + hard), qp.b.resize(laws + m + hard);
  qp.A.topLeftCorner(k + m, laws) = law_.transpose();
  qp.A.block(0, laws, k, m) = touch_.transpose();
  qp.b.head(laws) = -law_0_, qp.b.segment(laws, m) = demanded_;
  Eigen::Index next = laws + m;
  for (const auto & task : spec_.tasks)
  {
    if (!task.hard)
      continue;
    qp.b.segment(next, task.size) = tasks_.b.segment(task.first, task.size);
    if (task.is_force())
      qp.A.block(k, next, m, task.size) = spec_.mass * tasks_.F.middleRows(task.first, task.size).transpose();
    else
    {
      qp.A.block(0, next, k, task.size) = along_.middleCols(task.first, task.size);
      drop_rounding(qp.A.block(0, next, k, task.size), tasks_.J.middleRows(task.first, task.size).norm(), spec_.rank);
      if (holds_)
        qp.b.segment(next, task.size) -= tasks_.J.middleRows(task.first, task.size) * a_0_;
    }
    next += task.size;
  }
}

void TickProgram::recover(const VectorXd & x, VectorXd & a, VectorXd & tau, VectorXd & lam, VectorXd & rigid) const
{
  const Eigen::Index k = qp.split, m = touch_.rows();
  a = holds_ ? VectorXd(a_0_ + elimination_.N * x.head(k)) : VectorXd(x.head(k));
  const VectorXd f = spec_.mass * x.segment(k, m), t = spec_.mass * (torque_ * x + torque_0_);
  tau.setZero(a.size()), lam.setZero(scene_.rows), rigid.resize(spec_.rigid.size());
  for (std::size_t i = 0; i < spec_.motors.size(); ++i)
    tau[spec_.motors[i]] = t[i];
  for (Eigen::Index i = 0; i < m; ++i)
    lam[spec_.touching[i]] = f[i];
  if (!holds_)
    return;
  const VectorXd left = terms_.M * a + terms_.h - passive_ - tau - J_c_.transpose() * f;
  const VectorXd forces = elimination_.forces(left);
  for (std::size_t i = 0; i < spec_.held.size(); ++i)
    lam[spec_.held[i]] = forces[i];
  rigid = forces.tail(spec_.rigid.size());
}

VectorXd TickProgram::errors(const VectorXd & a, const VectorXd & lam) const
{
  VectorXd found = tasks_.J * a - tasks_.b;
  for (std::size_t i = 0; i < spec_.touching.size(); ++i)
    found += lam[spec_.touching[i]] * tasks_.F.col(i);
  return found;
}
} // namespace condyn
