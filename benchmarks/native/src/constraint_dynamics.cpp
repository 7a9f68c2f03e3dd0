#include "methods.hpp"

#include <pinocchio/algorithm/constrained-dynamics-derivatives.hpp>
#include <pinocchio/algorithm/constrained-dynamics.hpp>

namespace condyn
{
namespace
{

/// Pinocchio's constraintDynamics: a sparse Cholesky decomposition of the constrained system.
class ConstraintDynamics : public Method
{
public:
  ConstraintDynamics(const Scene & scene, double mu, const Settings & settings)
  : ConstraintDynamics("constraintDynamics", scene, mu, settings)
  {
  }

  void run(const State & state) override { solve(state); }

  Answer answer() const override { return {data_.ddq, data_.lambda_c, settings_.iter}; }

protected:
  ConstraintDynamics(
    const std::string & name, const Scene & scene, double mu, const Settings & settings)
  : Method(name, mu)
  , model_(scene.model)
  , constraints_(scene.constraints)
  , data_(scene.model)
  , datas_(create_datas(scene.constraints))
  , settings_(settings.accuracy, mu, settings.max_iterations)
  {
#if PINOCCHIO_MAJOR_VERSION >= 4
    pinocchio::initConstraintDynamics(model_, data_, constraints_, datas_);
#else
    pinocchio::initConstraintDynamics(model_, data_, constraints_);
#endif
  }

  void solve(const State & state)
  {
    pinocchio::constraintDynamics(
      model_, data_, state.q, state.v, state.tau, constraints_, datas_, settings_);
  }

  const pinocchio::Model & model_;
  const Constraints & constraints_;
  pinocchio::Data data_;
  ConstraintDatas datas_;
  pinocchio::ProximalSettings settings_;
};

/// All six derivatives of a and lam by q, v and tau; the constraintDynamics they start from is not
/// counted, but its iterations are: Pinocchio repeats as many of its own. The two derivatives by
/// tau are judged, because their exact values need no differences.
class Derivatives final : public ConstraintDynamics
{
public:
  Derivatives(const Scene & scene, double mu, const Settings & settings)
  : ConstraintDynamics("computeConstraintDynamicsDerivatives", scene, mu, settings)
  {
  }

  void prepare(const State & state) override { solve(state); }

  void run(const State &) override
  {
    pinocchio::computeConstraintDynamicsDerivatives(
      model_, data_, constraints_, datas_, settings_);
  }

  Answer answer() const override
  {
    return {data_.ddq_dtau, data_.dlambda_dtau, settings_.iter};
  }

  Question question(const Question & acceleration) const override
  {
    const auto nv = acceleration.M.rows();
    const auto rows = acceleration.J.rows();
    return {
      acceleration.M, acceleration.J, Eigen::MatrixXd::Identity(nv, nv),
      Eigen::MatrixXd::Zero(rows, nv)};
  }
};

} // namespace

MethodPtr make_constraint_dynamics(const Scene & scene, double mu, const Settings & settings)
{
  return std::make_unique<ConstraintDynamics>(scene, mu, settings);
}

MethodPtr make_derivatives(const Scene & scene, double mu, const Settings & settings)
{
  return std::make_unique<Derivatives>(scene, mu, settings);
}

} // namespace condyn
