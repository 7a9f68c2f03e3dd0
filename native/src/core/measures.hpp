// What is said of every sample of a motion.
#pragma once
#include "largest.hpp"
#include "rows.hpp"

namespace condyn
{
/// Writes violation, slip, kinetic and potential energy [m, m/s, J, J], after forward kinematics with (q, v)
/// and the rows at it.
inline void write_measures(const Model & model, const Data & data, const Rows & rows, const VectorXd & v, double * four)
{
  double kinetic = v.cwiseAbs2().dot(model.armature) / 2, potential = 0;
  for (int i = 1; i < model.njoints; ++i)
  {
    const auto & Y = model.inertias[i];
    kinetic += Y.vtiv(data.v[i]) / 2;
    potential -= Y.mass() * (data.oMi[i].act(Y.lever())).dot(model.gravity.linear());
  }
  four[0] = largest(rows.c), four[1] = largest(rows.velocity), four[2] = kinetic, four[3] = potential;
}
} // namespace condyn
