// The methods that are timed. One file each; methods.cpp lists them.
#pragma once

#include "reference.hpp"

#include <memory>
#include <string>
#include <vector>

namespace condyn
{

/// What the proximal methods share; mu is varied.
struct Settings
{
  double accuracy = 1e-10;
  int max_iterations = 20;
};

/// One way to an answer, with all its memory allocated beforehand.
class Method
{
public:
  Method(std::string name, double mu)
  : name(std::move(name))
  , mu(mu)
  {
  }
  virtual ~Method() = default;

  /// What run needs and somebody else has paid for; not timed.
  virtual void prepare(const State &) {}
  /// The work that is timed.
  virtual void run(const State & state) = 0;
  /// Copies out what the last run found; not timed.
  virtual Answer answer() const = 0;
  /// Most methods are asked for the acceleration.
  virtual Question question(const Question & acceleration) const { return acceleration; }

  const std::string name;
  const double mu;
};

using MethodPtr = std::unique_ptr<Method>;

MethodPtr make_aba(const Scene & scene);
MethodPtr make_dense(const Scene & scene, double mu);
MethodPtr make_constraint_dynamics(const Scene & scene, double mu, const Settings & settings);
MethodPtr make_derivatives(const Scene & scene, double mu, const Settings & settings);

/// Pinocchio 4 only.
MethodPtr make_lcaba(const Scene & scene, double mu, const Settings & settings);

/// Null where Pinocchio cannot do the scene: both take contacts with the world, not loops, and
/// those of Pinocchio 4 take either balls or welds, not a mixture.
MethodPtr make_pv(const Scene & scene, double mu, const Settings & settings);
MethodPtr make_constrained_aba(const Scene & scene, double mu, const Settings & settings);

/// Everything that fits the scene; the proximal methods once for each mu.
std::vector<MethodPtr> make_methods(
  const Scene & scene, bool redundant, const std::vector<double> & mus, const Settings & settings);

} // namespace condyn
