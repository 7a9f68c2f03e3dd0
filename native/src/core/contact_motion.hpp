// One motion with contacts: steps one after the other, and samples of them.
#pragma once
#include "arrays.hpp"
#include "contact_steps.hpp"
#include <atomic>

namespace condyn
{
/// Samples of motions, a row each, with a, lam and contacts or without rows for them.
struct ContactMotions
{
  Array<double, 2> t;
  // contact: natural residual, work, modes, and work of drives where there are any
  Array<double, 3> q, v, a, lam, contact, measures, work;
  Array<int, 1> done; // 1, or 0 for a motion that has stopped before a step that is left to Python
  Array<double, 1> times; // [s]
};

/// How far motions go, and what ends them early.
struct MotionEnds
{
  int steps, every; // which sample is kept
  double closed; // gap [m, rad] and slip at the start that are closed without a doubt
  double lost; // velocity of no machine [rad/s, m/s]
};

/// A motion on its way.
struct Way
{
  int step;
  VectorXd q, v;
  Eigen::Vector4d work;
};

/// Takes a motion, the i-th of those that are written, to its end; false where it stops before. A `step` of -1
/// says that it is not to go on.
bool run_motion(
  ContactSteps & steps, Way & way, const MotionEnds & ends, double dt, const ContactMotions & to, std::size_t i,
  const std::atomic<bool> & stop);
} // namespace condyn
