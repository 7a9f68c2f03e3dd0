// Where the paths of a step end, and steps with contacts as they are there.
//
//   gap(q (+) dt v+)  ~  gap_e + dt J_e (v+ - u),    gap_e and J_e at q (+) dt u
//
// `condyn_pin/stepping/step_problem.py` has the same in Python.
#include "contact_steps.hpp"
#include "islands.hpp"
#include <algorithm>
#include <cmath>

namespace condyn
{
namespace
{
constexpr int again_at_most = 6; // as `_AGAIN`
} // namespace

/// The step again, with contacts as they are where a path along u ends.
void ContactSteps::pose_along(const VectorXd & u)
{
  floating_.integrate(mechanics_, free_.q, plan_.dt * u, ends_);
  mechanics_.jacobians(ends_);
  candidates.gaps(mechanics_.data, ends_, gap_there_);
  candidates.rows(mechanics_.data, J_there_);
  floating_.rows_before(J_there_, u, plan_.dt);
  Flags active = touching_.active;
  for (int i = 0; i < candidates.with_gaps(); ++i)
    active[i] = active[i] || gap_there_[i] < 0;
  const double reach = std::max(plan_.near, 2 * plan_.dt * largest(u));
  for (const auto & [first, end] : candidates.several) // as they meet there
    for (int i = first; i < end; ++i)
      active[i] = gap_there_[i] < reach;
  touching_.choose(active, candidates, plan_);
  touching_.along_path = true, touching_.path = u;
  touching_.eliminate(J_there_, candidates, free_);
  const VectorXd speeds = touching_.J_c * u, start = begun();
  VectorXd here(touching_.with_gaps), bends(touching_.with_gaps);
  for (int i = 0; i < touching_.with_gaps; ++i)
  {
    here[i] = start[touching_.chosen[i]];
    bends[i] = gap_there_[touching_.chosen[i]] - here[i] - plan_.dt * speeds[touching_.problem.normal(i)];
  }
  touching_.ask(here, bends, free_, plan_);
}

/// Gaps at the beginning for the places of the end: of shapes that meet in several points the deepest, or zero.
VectorXd ContactSteps::begun() const
{
  VectorXd start = gaps_;
  for (const auto & [first, end] : candidates.several)
    start.segment(first, end - first).setConstant(std::min(gaps_.segment(first, end - first).minCoeff(), 0.0));
  return start;
}

/// How far from where it should a contact ends at most, too deep or pressed on before it touches.
double ContactSteps::off()
{
  const VectorXd & v1 = touching_.v1;
  if (plan_.dt * largest(v1) < plan_.straight && largest(touching_.bends) < plan_.missed && !touching_.along_path)
    return 0.0;
  floating_.integrate(mechanics_, free_.q, plan_.dt * v1, ends_);
  mechanics_.place(ends_);
  candidates.gaps(mechanics_.data, ends_, gap_there_);
  const VectorXd start = begun();
  for (Eigen::Index i = 0; i < gap_there_.size(); ++i)
    gap_there_[i] -= start[i] - plan_.allowed(start[i]);
  for (int i = 0; i < touching_.with_gaps; ++i)
    if (const int k = touching_.chosen[i]; touching_.is_pressed(i, plan_))
      gap_there_[k] += touching_.allowed[i] - plan_.allowed(start[k]);
  for (const auto & [first, end] : candidates.several) // they have other points there
    gap_there_.segment(first, end - first).setConstant(gap_there_.segment(first, end - first).minCoeff());
  double worst = gap_there_.size() ? std::max(0.0, -gap_there_.minCoeff()) : 0.0;
  const Scale scale(touching_.problem);
  const VectorXd sigma = touching_.problem.velocities(touching_.lam);
  for (int i = 0; i < touching_.with_gaps; ++i)
  {
    const int n = touching_.problem.normal(i);
    if (!(touching_.lam[n] * scale.stiff > std::abs(sigma[n])))
      continue;
    worst = std::max(worst, gap_there_[touching_.chosen[i]] - plan_.dt * sigma[n]);
    if (!touching_.along_path)
      worst = std::max(worst, -touching_.bends[i]);
  }
  return worst;
}

/// Where paths curve, the nearest of some steps with contacts as they are where the one before ends.
bool ContactSteps::nearest()
{
  double off_by = off();
  if (!(off_by > plan_.missed))
    return true;
  if (!islands(touching_.problem).empty()) // Python takes each by its own paths
    return false;
  Touching best = touching_;
  double least = off_by, its_natural = natural;
  for (int tried = 1; off_by > plan_.missed && tried <= again_at_most; ++tried)
  {
    pose_along(touching_.along_path ? VectorXd(0.5 * (touching_.path + touching_.v1)) : touching_.v1);
    if (!solve())
      return false;
    off_by = off();
    if (off_by < least)
      best = touching_, least = off_by, its_natural = natural;
  }
  touching_ = std::move(best), natural = its_natural;
  return !(least > plan_.missed); // Python notes what ends elsewhere
}
} // namespace condyn
