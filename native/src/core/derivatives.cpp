#include "derivatives.hpp"
#include <pinocchio/algorithm/kinematics.hpp>
#include <pinocchio/algorithm/rnea-derivatives.hpp>
#include <Eigen/Cholesky>
#include <Eigen/QR>

namespace condyn
{
namespace
{
const double eps = std::ldexp(1.0, -52);
const double rank_tolerance = 1e-7, noise = 1e3; // as in Python: RANK and _NOISE

// Pivots between these, relative to the first, are neither rounding nor clearly more: Python looks.
const double nothing_below = 1e-9, something_above = 1e-5;

std::vector<char> moved_by(const Model & model, int joint)
{
  std::vector<char> moved(model.nv, 0);
  for (auto above : model.supports[joint])
    for (int k = 0; above && k < model.nvs[above]; ++k)
      moved[model.idx_vs[above] + k] = 1;
  return moved;
}
} // namespace

Derivatives::Derivatives(const Scene & scene, const Rank & rank)
: scene_(scene), rank_(rank), data_(scene.model), on_joint_(scene.model.njoints, Force::Zero())
{
  for (const auto & k : scene.constraints)
  {
    const auto one = moved_by(scene.model, k.joint1), two = moved_by(scene.model, k.joint2);
    columns_.emplace_back(), moves1_.emplace_back(), moves2_.emplace_back();
    for (int j = 0; j < scene.model.nv && k.kind != Kind::coupling; ++j)
      if (one[j] || two[j])
        columns_.back().push_back(j), moves1_.back().push_back(one[j]), moves2_.back().push_back(two[j]);
  }
}

bool Derivatives::operator()(
  const VectorXd & q, const VectorXd & v, const VectorXd & a, const VectorXd & lam, double * const out[6])
{
  const int n = scene_.model.nv, m = scene_.rows;
  linearise(q, v, a, lam);
  const Eigen::LLT<MatrixXd, Eigen::Upper> llt(data_.M);
  if (llt.info() != Eigen::Success || (m && !(J_.squaredNorm() > rank_.least)))
    return false;
  L_ = llt.matrixL();
  null_.resize(0, 0);
  if (m && (rank_.dependent || !independent()) && !minimum_norm(q, lam))
    return false;
  MatrixXd x = rhs_.topRows(n), z; // y, and then da
  L_.triangularView<Eigen::Lower>().solveInPlace(x);
  if (m)
  {
    z.noalias() = -Q_.transpose() * x;
    z.leftCols(2 * n).noalias() += B_inverse_ * rhs_.bottomLeftCorner(m, 2 * n);
    x.noalias() += Q_ * z;
    z = B_inverse_.transpose() * z; // dlam
  }
  L_.triangularView<Eigen::Lower>().transpose().solveInPlace(x);
  if (null_.size())
    z.leftCols(n) += null_;
  for (int k = 0; k < 3; ++k)
  {
    Eigen::Map<RowMajor>(out[k], n, n) = x.middleCols(k * n, n);
    if (m)
      Eigen::Map<RowMajor>(out[3 + k], m, n) = z.middleCols(k * n, n);
  }
  return x.allFinite() && z.allFinite();
}

void Derivatives::linearise(const VectorXd & q, const VectorXd & v, const VectorXd & a, const VectorXd & lam)
{
  const int n = scene_.model.nv, m = scene_.rows;
  for (auto & f : on_joint_)
    f.setZero();
  VectorXd of_couplings = VectorXd::Zero(n); // J^T lam that does not change
  pinocchio::forwardKinematics(scene_.model, data_, q);
  add_wrenches(scene_, data_, lam, on_joint_, of_couplings);
  pinocchio::computeRNEADerivatives(scene_.model, data_, q, v, a, on_joint_);
  rhs_.setZero(n + m, 3 * n), J_.setZero(m, n);
  rhs_.topLeftCorner(n, n) = -data_.dtau_dq, rhs_.block(0, n, n, n) = -data_.dtau_dv;
  rhs_.topRightCorner(n, n).setIdentity();
  for (std::size_t i = 0; i < scene_.constraints.size(); ++i)
    write(i, lam);
}

/// Writes the rows of a constraint into J and -[s_q, s_v], and adds what turns of J^T lam to -r_q.
void Derivatives::write(std::size_t i, const VectorXd & lam)
{
  const Constraint & k = scene_.constraints[i];
  const int n = scene_.model.nv;
  const double kp = scene_.kp, kd = scene_.kd;
  if (k.kind == Kind::coupling)
  {
    J_(k.first, k.v_a) = 1.0, J_(k.first, k.v_b) = -k.length;
    rhs_.row(n + k.first).head(n) = -kp * J_.row(k.first);
    rhs_.row(n + k.first).segment(n, n) = -kd * J_.row(k.first);
    return;
  }
  const Linearised of(k, data_, k.sign * lam.segment(k.first, k.size));
  const auto & columns = columns_[i];
  const int count = int(columns.size());
  Matrix6x J1(6, count), J2(6, count), w1(6, count), w2(6, count);
  for (int c = 0; c < count; ++c)
  {
    const int j = columns[c];
    const Column one = of.at1(j, moves1_[i][c]), two = of.at2(j, moves2_[i][c]);
    const RowPartials by = of(one, two);
    for (int row = 0; row < k.size; ++row)
    {
      const int from = k.kind == Kind::rod ? 0 : k.selection[row], to = k.first + row;
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

/// By L^-1 J^T = Q R, unless a pivot of R is rounding.
bool Derivatives::independent()
{
  const int n = int(L_.rows()), m = int(J_.rows());
  if (m > n)
    return false;
  MatrixXd A = J_.transpose();
  L_.triangularView<Eigen::Lower>().solveInPlace(A);
  const Eigen::HouseholderQR<MatrixXd> qr(A);
  const VectorXd pivots = qr.matrixQR().diagonal().cwiseAbs();
  const double largest = scene_.weights.maxCoeff(); // squared, the largest of M^-1: what J M^-1 J^T is rounded by
  const double rounding = eps * largest * largest * J_.squaredNorm();
  const double least = std::max(rank_tolerance * pivots.maxCoeff(), std::sqrt(noise * rounding));
  if (!(pivots.minCoeff() > least))
    return false;
  Q_ = qr.householderQ() * MatrixXd::Identity(n, m);
  B_inverse_ = qr.matrixQR().topRows(m).triangularView<Eigen::Upper>().transpose().solve(MatrixXd::Identity(m, m));
  return true;
}

/// With pivots on the columns, and what keeps lam the smallest as the rows turn.
bool Derivatives::minimum_norm(const VectorXd & q, const VectorXd & lam)
{
  const int n = int(L_.rows()), m = scene_.rows;
  MatrixXd A = J_.transpose();
  L_.triangularView<Eigen::Lower>().solveInPlace(A);
  const Eigen::ColPivHouseholderQR<MatrixXd> qr(A);
  const VectorXd pivots = qr.matrixR().diagonal().cwiseAbs();
  int rank = 0;
  for (double pivot : pivots)
    if (pivot > something_above * pivots[0])
      ++rank;
    else if (!(pivot < nothing_below * pivots[0]))
      return false;
  Q_ = qr.householderQ() * MatrixXd::Identity(n, rank);
  const MatrixXd R = qr.matrixR().topRows(rank).triangularView<Eigen::Upper>();
  const MatrixXd B = qr.colsPermutation() * R.transpose(); // of full column rank: Q2 R2
  const Eigen::HouseholderQR<MatrixXd> of_rows(B);
  const MatrixXd Q2 = of_rows.householderQ() * MatrixXd::Identity(m, rank);
  B_inverse_ = of_rows.matrixQR().topRows(rank).triangularView<Eigen::Upper>().solve(MatrixXd(Q2.transpose()));
  // lam = J w, with the smallest w in the metric of M
  VectorXd w = Q_ * (B_inverse_ * lam);
  L_.triangularView<Eigen::Lower>().transpose().solveInPlace(w);
  const MatrixXd turned = turning(q, w);
  null_ = turned - Q2 * (Q2.transpose() * turned);
  return true;
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
    for (std::size_t c = 0; c < columns_[i].size(); ++c)
    {
      const int j = columns_[i][c];
      const RowPartials by = of(of.at1(j, moves1_[i][c]), of.at2(j, moves2_[i][c]));
      for (int row = 0; row < k.size; ++row)
        turned(k.first + row, j) = k.sign * by.v_q[k.kind == Kind::rod ? 0 : k.selection[row]];
    }
  }
  return turned;
}
} // namespace condyn
