#include "methods.hpp"

#include <pinocchio/algorithm/pv.hpp>

#include <algorithm>

namespace condyn
{
namespace
{

/// The Popov-Vereshchagin algorithm, or its proximal kin constrainedABA: linear in the joints.
template<typename Constraint>
class PopovVereshchagin : public Method
{
public:
  PopovVereshchagin(
    const std::string & name,
    const pinocchio::Model & model,
    std::vector<Constraint> constraints,
    double mu,
    const Settings & settings)
  : Method(name, mu)
  , model_(model)
  , constraints_(std::move(constraints))
  , data_(model)
  , settings_(settings.accuracy, mu, settings.max_iterations)
  {
    for (const auto & constraint : constraints_)
      datas_.emplace_back(constraint);
    pinocchio::initPvSolver(model_, data_, constraints_);
  }

  // Neither counts its iterations, and only pv keeps its forces (in an order of its own).
  Answer answer() const override { return {data_.ddq, std::nullopt, std::nullopt}; }

protected:
  const pinocchio::Model & model_;
  const std::vector<Constraint> constraints_;
  pinocchio::Data data_;
  std::vector<typename Constraint::ConstraintData> datas_;
  pinocchio::ProximalSettings settings_;
};

template<typename Constraint>
class Pv final : public PopovVereshchagin<Constraint>
{
public:
  using PopovVereshchagin<Constraint>::PopovVereshchagin;

  void run(const State & state) override
  {
    pinocchio::pv(
      this->model_, this->data_, state.q, state.v, state.tau, this->constraints_, this->datas_,
      this->settings_);
  }
};

template<typename Constraint>
class ConstrainedAba final : public PopovVereshchagin<Constraint>
{
public:
  using PopovVereshchagin<Constraint>::PopovVereshchagin;

  void run(const State & state) override
  {
    pinocchio::constrainedABA(
      this->model_, this->data_, state.q, state.v, state.tau, this->constraints_, this->datas_,
      this->settings_);
  }
};

bool only_contacts_with_the_world(const Constraints & constraints)
{
  return std::all_of(constraints.begin(), constraints.end(), [](const auto & constraint) {
    return constraint.joint2_id == 0;
  });
}

#if PINOCCHIO_MAJOR_VERSION >= 4

/// These headers compile for Pinocchio's new anchor constraints, but not for rigid ones.
template<typename Anchor>
std::vector<Anchor> to_anchors(const Scene & scene)
{
  std::vector<Anchor> anchors;
  for (const auto & constraint : scene.constraints)
    anchors.emplace_back(scene.model, constraint.joint1_id, constraint.joint1_placement);
  return anchors;
}

template<template<typename> class Algorithm>
MethodPtr make(const std::string & name, const Scene & scene, double mu, const Settings & settings)
{
  const auto all_of_type = [&](pinocchio::ContactType type) {
    return std::all_of(
      scene.constraints.begin(), scene.constraints.end(),
      [&](const auto & constraint) { return constraint.type == type; });
  };
  if (scene.constraints.empty() || !only_contacts_with_the_world(scene.constraints))
    return nullptr;
  using Weld = pinocchio::FrameAnchorConstraintModel;
  using Ball = pinocchio::PointAnchorConstraintModel;
  if (all_of_type(pinocchio::CONTACT_6D))
    return std::make_unique<Algorithm<Weld>>(
      name, scene.model, to_anchors<Weld>(scene), mu, settings);
  if (all_of_type(pinocchio::CONTACT_3D))
    return std::make_unique<Algorithm<Ball>>(
      name, scene.model, to_anchors<Ball>(scene), mu, settings);
  return nullptr;
}

#else

template<template<typename> class Algorithm>
MethodPtr make(const std::string & name, const Scene & scene, double mu, const Settings & settings)
{
  if (scene.constraints.empty() || !only_contacts_with_the_world(scene.constraints))
    return nullptr;
  return std::make_unique<Algorithm<pinocchio::RigidConstraintModel>>(
    name, scene.model, scene.constraints, mu, settings);
}

#endif

} // namespace

MethodPtr make_pv(const Scene & scene, double mu, const Settings & settings)
{
  return make<Pv>("pv", scene, mu, settings);
}

MethodPtr make_constrained_aba(const Scene & scene, double mu, const Settings & settings)
{
  return make<ConstrainedAba>("constrainedABA", scene, mu, settings);
}

} // namespace condyn
