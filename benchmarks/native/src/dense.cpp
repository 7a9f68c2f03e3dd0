#include "methods.hpp"

#include <Eigen/Cholesky>

namespace condyn
{
namespace
{

/// Block Cholesky of [M, Jᵀ; J, -mu 1], sparsity ignored; building M, h, J and gamma is counted.
///
/// Eigen's LDLT pivots on single diagonal entries only, which an indefinite matrix does not allow;
/// the two definite blocks do without pivoting.
class Dense final : public Method
{
public:
  Dense(const Scene & scene, double mu)
  : Method("dense", mu)
  , terms_(scene)
  , M_factor_(scene.model.nv)
  , S_factor_(rows(scene.constraints))
  , Y_(scene.model.nv, rows(scene.constraints))
  , S_(rows(scene.constraints), rows(scene.constraints))
  , a_(scene.model.nv)
  , lam_(rows(scene.constraints))
  {
  }

  void run(const State & state) override
  {
    terms_.compute(state);

    M_factor_.compute(terms_.M());
    const auto L = M_factor_.matrixL();
    a_ = state.tau - terms_.h();
    L.solveInPlace(a_);

    if (lam_.size() > 0)
    {
      Y_ = terms_.J().transpose();
      L.solveInPlace(Y_);
      S_.setZero();
      S_.diagonal().setConstant(mu);
      S_.selfadjointView<Eigen::Lower>().rankUpdate(Y_.transpose());
      S_factor_.compute(S_);
      lam_ = -terms_.gamma();
      lam_.noalias() -= Y_.transpose() * a_;
      S_factor_.solveInPlace(lam_);
      a_.noalias() += Y_ * lam_;
    }
    M_factor_.matrixU().solveInPlace(a_);
  }

  Answer answer() const override { return {a_, lam_, std::nullopt}; }

private:
  Terms terms_;
  Eigen::LLT<Eigen::MatrixXd, Eigen::Upper> M_factor_;
  Eigen::LLT<Eigen::MatrixXd> S_factor_;
  Eigen::MatrixXd Y_, S_; // L^-1 Jᵀ and J M^-1 Jᵀ + mu 1
  Eigen::VectorXd a_, lam_;
};

} // namespace

MethodPtr make_dense(const Scene & scene, double mu)
{
  return std::make_unique<Dense>(scene, mu);
}

} // namespace condyn
