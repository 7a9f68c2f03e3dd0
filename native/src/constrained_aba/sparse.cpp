// Pinocchio's own calls, to compare with: aba without constraints, and constraintDynamics.
#include "method.hpp"

#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/constrained-dynamics.hpp>

namespace condyn
{
namespace
{

class Aba final : public Method
{
public:
  Aba(const Scene & scene, const Settings & settings)
  : Method(scene, settings)
  , data_(scene.model)
  {
  }

  int solve(const In & q, const In & v, const In & tau, Out a) override
  {
    a = pinocchio::aba(model, data_, q, v, tau, pinocchio::Convention::LOCAL);
    return 1;
  }

private:
  Data data_;
};

class ConstraintDynamics final : public Method
{
public:
  ConstraintDynamics(const Scene & scene, const Settings & settings)
  : Method(scene, settings)
  , data_(scene.model)
  , settings_(0.0, settings.accuracy, settings.mu, settings.limit)
  {
    for (const auto & constraint : scene.constraints)
      datas_.emplace_back(constraint);
#if PINOCCHIO_MAJOR_VERSION >= 4
    pinocchio::initConstraintDynamics(model, data_, scene.constraints, datas_);
#else
    pinocchio::initConstraintDynamics(model, data_, scene.constraints);
#endif
  }

  int solve(const In & q, const In & v, const In & tau, Out a) override
  {
    a = pinocchio::constraintDynamics(model, data_, q, v, tau, scene.constraints, datas_, settings_);
    lam = data_.lambda_c;
    return settings_.iter;
  }

private:
  Data data_;
  PINOCCHIO_ALIGNED_STD_VECTOR(RigidData) datas_;
  pinocchio::ProximalSettings settings_;
};

} // namespace

MethodPtr make_aba(const Scene & scene, const Settings & settings)
{
  return std::make_unique<Aba>(scene, settings);
}

MethodPtr make_constraint_dynamics(const Scene & scene, const Settings & settings)
{
  return std::make_unique<ConstraintDynamics>(scene, settings);
}

} // namespace condyn
