#include "methods.hpp"

#include <pinocchio/algorithm/loop-constrained-aba.hpp>

namespace condyn
{
namespace
{

/// The articulated-body algorithm for closed loops, of Pinocchio 4.
class Lcaba final : public Method
{
public:
  Lcaba(const Scene & scene, double mu, const Settings & settings)
  : Method("lcaba", mu)
  , model_(scene.model)
  , constraints_(scene.constraints)
  , data_(scene.model)
  , datas_(create_datas(scene.constraints))
  , settings_(settings.accuracy, mu, settings.max_iterations)
  {
    pinocchio::computeJointMinimalOrdering(model_, data_, constraints_);
  }

  void run(const State & state) override
  {
    // Welds read the accelerations of the call before; without this every second answer is wrong.
    for (const auto & constraint : constraints_)
    {
      data_.oa[constraint.joint1_id].setZero();
      data_.oa[constraint.joint2_id].setZero();
    }
    pinocchio::lcaba(
      model_, data_, state.q, state.v, state.tau, constraints_, datas_, settings_);
  }

  Answer answer() const override
  {
    Eigen::VectorXd lam(rows(constraints_));
    int row = 0;
    for (std::size_t i = 0; i < constraints_.size(); ++i)
    {
      const int count = rows(constraints_[i]);
      // contact_force acts on the second body.
      lam.segment(row, count) = -datas_[i].contact_force.toVector().head(count);
      row += count;
    }
    return {data_.ddq, lam, settings_.iter};
  }

private:
  const pinocchio::Model & model_;
  const Constraints & constraints_;
  pinocchio::Data data_;
  ConstraintDatas datas_;
  pinocchio::ProximalSettings settings_;
};

} // namespace

MethodPtr make_lcaba(const Scene & scene, double mu, const Settings & settings)
{
  return std::make_unique<Lcaba>(scene, mu, settings);
}

} // namespace condyn
