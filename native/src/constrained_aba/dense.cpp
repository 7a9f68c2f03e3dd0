// The whole matrix, sparsity ignored; to build M, h, J and gamma is part of the work.
//
//   [ M   J^T  ] [   a  ]   [ tau - h ]
//   [ J  -mu 1 ] [ -lam ] = [ -gamma  ]
#include "method.hpp"
#include "terms.hpp"

#include <Eigen/Cholesky>

namespace condyn
{
namespace
{

/// One L D L^T of it. Eigen's pivots on single entries of the diagonal, the largest first: those of
/// M, and what J leaves of the zeros behind them, which is -J M^-1 J^T.
class DenseLdlt final : public Method
{
public:
  DenseLdlt(const Scene & scene, const Settings & settings)
  : Method(scene, settings)
  , terms_(scene)
  , K_(size(), size())
  , factor_(size())
  , x_(size())
  {
  }

  int solve(const In & q, const In & v, const In & tau, Out a) override
  {
    const int n = model.nv, m = scene.rows;
    terms_.compute(q, v);
    // its lower half is read
    K_.topLeftCorner(n, n).triangularView<Eigen::Lower>() = terms_.M().transpose();
    K_.bottomLeftCorner(m, n) = terms_.J();
    K_.bottomRightCorner(m, m).setZero();
    K_.bottomRightCorner(m, m).diagonal().setConstant(-settings.mu);
    factor_.compute(K_);
    if (factor_.info() != Eigen::Success)
      return 0;
    x_.head(n) = tau - terms_.h();
    x_.tail(m) = -terms_.gamma();
    x_ = factor_.solve(x_).eval();
    a = x_.head(n);
    lam = -x_.tail(m);
    return 1;
  }

private:
  int size() const { return model.nv + scene.rows; }

  Terms terms_;
  MatrixXd K_;
  Eigen::LDLT<MatrixXd> factor_;
  VectorXd x_;
};

/// Its two definite blocks by Cholesky, M and then J M^-1 J^T + mu 1: no pivots, fewer products.
class DenseBlocks final : public Method
{
public:
  DenseBlocks(const Scene & scene, const Settings & settings)
  : Method(scene, settings)
  , terms_(scene)
  , M_factor_(scene.model.nv)
  , S_factor_(scene.rows)
  , Y_(scene.model.nv, scene.rows)
  , S_(scene.rows, scene.rows)
  {
  }

  int solve(const In & q, const In & v, const In & tau, Out a) override
  {
    terms_.compute(q, v);
    M_factor_.compute(terms_.M());
    if (M_factor_.info() != Eigen::Success)
      return 0;
    const auto L = M_factor_.matrixL();
    a = tau - terms_.h();
    L.solveInPlace(a);
    if (scene.rows > 0)
    {
      Y_ = terms_.J().transpose();
      L.solveInPlace(Y_);
      S_.setZero();
      S_.diagonal().setConstant(settings.mu);
      S_.selfadjointView<Eigen::Lower>().rankUpdate(Y_.transpose());
      S_factor_.compute(S_);
      if (S_factor_.info() != Eigen::Success)
        return 0;
      lam = -terms_.gamma();
      lam.noalias() -= Y_.transpose() * a;
      S_factor_.solveInPlace(lam);
      a.noalias() += Y_ * lam;
    }
    M_factor_.matrixU().solveInPlace(a);
    return 1;
  }

private:
  Terms terms_;
  Eigen::LLT<MatrixXd, Eigen::Upper> M_factor_;
  Eigen::LLT<MatrixXd> S_factor_;
  MatrixXd Y_, S_; // L^-1 J^T, and J M^-1 J^T + mu 1
};

} // namespace

MethodPtr make_dense_ldlt(const Scene & scene, const Settings & settings)
{
  return std::make_unique<DenseLdlt>(scene, settings);
}

MethodPtr make_dense_blocks(const Scene & scene, const Settings & settings)
{
  return std::make_unique<DenseBlocks>(scene, settings);
}

} // namespace condyn
