// Ways to solve  M a + h = tau + J^T lam,  J a + gamma = a_ref.
#pragma once

#include "scene.hpp"

#include <memory>
#include <string>

namespace condyn
{

struct Settings
{
  double mu;       // proximal weight, or the damping of a dense matrix [1/kg]
  double accuracy; // what ends an iteration: each method says of what
  int limit;       // of iterations
};

/// One way, with the memory for one thread.
class Method
{
public:
  Method(const Scene & scene, const Settings & settings)
  : scene(scene)
  , model(scene.model)
  , settings(settings)
  , lam(VectorXd::Zero(scene.rows))
  {
  }
  virtual ~Method() = default;
  Method(const Method &) = delete;

  /// Writes a and `lam`; returns the iterations made, and 0 where a matrix is singular.
  virtual int solve(const In & q, const In & v, const In & tau, Out a) = 0;

  const Scene & scene;
  const Model & model;
  const Settings settings;
  VectorXd lam; // forces on the first body of each constraint, in the axes of its frame there
};

using MethodPtr = std::unique_ptr<Method>;

/// Names in the order in which tables show them.
std::vector<std::string> method_names();

/// Throws std::invalid_argument for another name, and for constraints that the method cannot take.
MethodPtr make_method(const std::string & name, const Scene & scene, const Settings & settings);

/// Refuses loops: the recursions of Popov and Vereshchagin hold bodies at the world alone.
void check_with_world(const Scene & scene, const std::string & name);

// Those of Pinocchio 3.9 alone, and of 4.1 alone, are named in method.cpp.
MethodPtr make_lcaba(const Scene & scene, const Settings & settings);
MethodPtr make_aba(const Scene & scene, const Settings & settings);
MethodPtr make_constrained_aba(const Scene & scene, const Settings & settings);
MethodPtr make_pinocchios_constrained_aba(const Scene & scene, const Settings & settings);
MethodPtr make_pv(const Scene & scene, const Settings & settings);
MethodPtr make_constraint_dynamics(const Scene & scene, const Settings & settings);
MethodPtr make_dense_ldlt(const Scene & scene, const Settings & settings);
MethodPtr make_dense_blocks(const Scene & scene, const Settings & settings);

} // namespace condyn
