#include "methods.hpp"

#include <pinocchio/algorithm/aba.hpp>

namespace condyn
{
namespace
{

/// The articulated-body algorithm without constraints: what dynamics costs at least.
class Aba final : public Method
{
public:
  explicit Aba(const Scene & scene)
  : Method("aba", 0.)
  , model_(scene.model)
  , data_(scene.model)
  {
  }

  void run(const State & state) override
  {
    pinocchio::aba(model_, data_, state.q, state.v, state.tau);
  }

  Answer answer() const override { return {data_.ddq, std::nullopt, std::nullopt}; }

  Question question(const Question & acceleration) const override
  {
    Question unconstrained = acceleration;
    unconstrained.J.resize(0, model_.nv);
    unconstrained.C.resize(0, 1);
    return unconstrained;
  }

private:
  const pinocchio::Model & model_;
  pinocchio::Data data_;
};

} // namespace

MethodPtr make_aba(const Scene & scene)
{
  return std::make_unique<Aba>(scene);
}

} // namespace condyn
