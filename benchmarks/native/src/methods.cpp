#include "methods.hpp"

namespace condyn
{

namespace
{

// Enough for Cholesky to pass over the singular directions of redundant rows.
const double dense_mu = 1e-9;

} // namespace

std::vector<MethodPtr> make_methods(
  const Scene & scene, bool redundant, const std::vector<double> & mus, const Settings & settings)
{
  std::vector<MethodPtr> methods;
  methods.push_back(make_aba(scene));
  methods.push_back(make_dense(scene, redundant ? dense_mu : 0.));
  for (const double mu : mus)
  {
    methods.push_back(make_constraint_dynamics(scene, mu, settings));
    methods.push_back(make_derivatives(scene, mu, settings));
#if PINOCCHIO_MAJOR_VERSION >= 4
    methods.push_back(make_lcaba(scene, mu, settings));
#endif
    if (auto pv = make_pv(scene, mu, settings))
      methods.push_back(std::move(pv));
    if (auto constrained_aba = make_constrained_aba(scene, mu, settings))
      methods.push_back(std::move(constrained_aba));
  }
  return methods;
}

} // namespace condyn
