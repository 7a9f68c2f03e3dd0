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
  M_ = data_.M.selfadjointView<Eigen::Upper>();
  const Eigen::LLT<MatrixXd> llt(M_);
  if (llt.info() != Eigen::Success || (m && !(J_.squaredNorm() > rank_.least)))
    return false;
  L_ = llt.matrixL();
  MatrixXd L_inv = MatrixXd::Identity(n, n);
  llt.matrixL().solveInPlace(L_inv);
  M_inv_.setZero(n, n);
  M_inv_.selfadjointView<Eigen::Lower>().rankUpdate(L_inv.transpose());
  M_inv_.triangularView<Eigen::StrictlyUpper>() = M_inv_.transpose();
  Y_.noalias() = M_inv_ * J_.transpose();
  null_.resize(0, 0);
  if (m && (rank_.dependent || !independent()) && !minimum_norm(q, lam))
    return false;
  left_.resize(n + m, m ? K_.cols() : 0);
  if (m)
    left_.topRows(n).noalias() = Y_ * K_, left_.bottomRows(m) = K_;
  MatrixXd by_state = solve(rhs_), by_tau(n + m, n);
  by_tau.noalias() = -left_ * left_.topRows(n).transpose();
  by_tau.topRows(n) += M_inv_;
  if (rank_.ill)
  {
    const auto left_over = [&](const MatrixXd & x, MatrixXd answer) {
      MatrixXd left = x;
      left.topRows(n) -= M_ * answer.topRows(n) - J_.transpose() * answer.bottomRows(m);
      left.bottomRows(m) -= J_ * answer.topRows(n);
      return MatrixXd(answer + solve(left));
    };
    by_state = left_over(rhs_, by_state);
    by_tau = left_over(MatrixXd::Identity(n + m, n), by_tau);
  }
  if (null_.size())
    by_state.bottomRows(m).leftCols(n) += null_;
  const auto put = [&](int i, const auto & part) { Eigen::Map<RowMajor>(out[i], part.rows(), part.cols()) = part; };
  put(0, by_state.topLeftCorner(n, n)), put(1, by_state.topRightCorner(n, n)), put(2, by_tau.topRows(n));
  put(3, by_state.bottomLeftCorner(m, n)), put(4, by_state.bottomRightCorner(m, n)), put(5, by_tau.bottomRows(m));
  return by_state.allFinite() && by_tau.allFinite();
}

MatrixXd Derivatives::solve(const MatrixXd & x) const
{
  const int n = scene_.model.nv, m = scene_.rows;
  MatrixXd along = -left_.topRows(n).transpose() * x.topRows(n), answer(n + m, x.cols());
  along.noalias() += left_.bottomRows(m).transpose() * x.bottomRows(m);
  answer.noalias() = left_ * along;
  answer.topRows(n).noalias() += M_inv_ * x.topRows(n);
  return answer;
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
  rhs_.setZero(n + m, 2 * n), J_.setZero(m, n);
  rhs_.topLeftCorner(n, n) = -data_.dtau_dq, rhs_.topRightCorner(n, n) = -data_.dtau_dv;
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
    rhs_.row(n + k.first).tail(n) = -kd * J_.row(k.first);
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

/// K = U^-1 of J M^-1 J^T = U^T U, unless a pivot is rounding.
bool Derivatives::independent()
{
  const MatrixXd G = J_ * Y_;
  const Eigen::LLT<MatrixXd, Eigen::Upper> llt(G);
  if (llt.info() != Eigen::Success)
    return false;
  const VectorXd pivots = llt.matrixLLT().diagonal();
  const double rounding = eps * M_inv_.diagonal().maxCoeff() * J_.squaredNorm();
  const double least = std::max(rank_tolerance * pivots.maxCoeff(), std::sqrt(noise * rounding));
  if (!(pivots.minCoeff() > least))
    return false;
  K_.setIdentity(G.rows(), G.cols());
  llt.matrixU().solveInPlace(K_);
  return true;
}

/// K, and what keeps lam the smallest as the rows turn.
bool Derivatives::minimum_norm(const VectorXd & q, const VectorXd & lam)
{
  const int m = scene_.rows;
  MatrixXd A = J_.transpose();
  L_.triangularView<Eigen::Lower>().solveInPlace(A); // the transpose of J L^-T
  const Eigen::ColPivHouseholderQR<MatrixXd> qr(A);
  const VectorXd pivots = qr.matrixR().diagonal().cwiseAbs();
  int rank = 0;
  for (double pivot : pivots)
    if (pivot > something_above * pivots[0])
      ++rank;
    else if (!(pivot < nothing_below * pivots[0]))
      return false;
  const MatrixXd R = qr.matrixR().topRows(rank).triangularView<Eigen::Upper>();
  const MatrixXd B = qr.colsPermutation() * R.transpose();
  const Eigen::HouseholderQR<MatrixXd> of_range(B);
  const MatrixXd Q2 = of_range.householderQ() * MatrixXd::Identity(m, rank);
  const MatrixXd R2 = of_range.matrixQR().topRows(rank).triangularView<Eigen::Upper>();
  K_ = R2.triangularView<Eigen::Upper>().solve(Q2.transpose()).transpose(); // B (B^T B)^-1 = Q2 R2^-T
  // lam = J w, with the smallest w: J = B W^T
  const MatrixXd Q1 = qr.householderQ() * MatrixXd::Identity(A.rows(), rank);
  const MatrixXd W = L_.triangularView<Eigen::Lower>() * Q1;
  const VectorXd along = R2.triangularView<Eigen::Upper>().solve(VectorXd(Q2.transpose() * lam));
  const VectorXd w = W * (W.transpose() * W).llt().solve(along);
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
