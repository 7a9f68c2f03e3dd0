// Articulated bodies that carry their constraints, loops too: lcaba, which Pinocchio 4 alone has.
#include "method.hpp"

#include <pinocchio/algorithm/loop-constrained-aba.hpp>

namespace condyn
{
namespace
{

class Lcaba final : public Method
{
public:
  Lcaba(const Scene & scene, const Settings & settings)
  : Method(scene, settings)
  , data_(scene.model)
  , settings_(settings.accuracy, 0.0, settings.mu, settings.limit)
  {
    for (const auto & constraint : scene.constraints)
      datas_.emplace_back(constraint);
    pinocchio::computeJointMinimalOrdering(model, data_, scene.constraints);
  }

  int solve(const In & q, const In & v, const In & tau, Out a) override
  {
    for (const auto & constraint : scene.constraints) // read before they are written
    {
      data_.oa[constraint.joint1_id].setZero();
      data_.oa[constraint.joint2_id].setZero();
    }
    pinocchio::lcaba(model, data_, q, v, tau, scene.constraints, datas_, settings_);
    a = data_.ddq;
    int row = 0;
    for (std::size_t k = 0; k < datas_.size(); row += scene.size(k), ++k)
      lam.segment(row, scene.size(k)) = -datas_[k].contact_force.toVector().head(scene.size(k));
    return settings_.iter;
  }

private:
  Data data_;
  PINOCCHIO_ALIGNED_STD_VECTOR(RigidData) datas_;
  pinocchio::ProximalSettings settings_;
};

} // namespace

MethodPtr make_lcaba(const Scene & scene, const Settings & settings)
{
  return std::make_unique<Lcaba>(scene, settings);
}

} // namespace condyn
