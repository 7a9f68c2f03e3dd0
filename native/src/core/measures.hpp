// What is said of every sample of a motion.
#pragma once
#include "largest.hpp"
#include "rows.hpp"
#include <algorithm>
#include <cmath>

namespace condyn
{
constexpr int measured = 6; // numbers of a sample

/// Writes violation, slip, kinetic and potential energy, that of springs [m, m/s, J], and what damping takes [W], after
/// forward kinematics with (q, v) and the rows at it.
inline void write_measures(
  const Scene & scene, const Data & data, const Rows & rows, const VectorXd & q, const VectorXd & v, double * numbers)
{
  const Model & model = scene.model;
  const Passive & passive = scene.passive;
  double kinetic = v.cwiseAbs2().dot(model.armature) / 2, potential = 0;
  for (int i = 1; i < model.njoints; ++i)
  {
    const auto & Y = model.inertias[i];
    kinetic += Y.vtiv(data.v[i]) / 2;
    potential -= Y.mass() * (data.oMi[i].act(Y.lever())).dot(model.gravity.linear());
  }
  double springs = 0, damping = v.cwiseAbs2().dot(passive.d);
  for (Eigen::Index s = 0; s < passive.k.size(); ++s)
    springs += passive.k[s] * std::pow(q[passive.at_q[s]] - passive.rest[s], 2) / 2;
  for (const SpringDamper & each : passive.between)
  {
    const Line line(each, data);
    springs += energy(each, line), damping += dissipation(each, line, data);
  }
  const double all[measured] = {largest(rows.c), largest(rows.velocity), kinetic, potential, springs, damping};
  std::copy_n(all, measured, numbers);
}
} // namespace condyn
