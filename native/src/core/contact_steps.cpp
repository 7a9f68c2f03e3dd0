#include "contact_steps.hpp"
#include "anchors.hpp"
#include "contact_solve.hpp"
#include "indeterminacy.hpp"
#include <algorithm>
#include <cmath>

namespace condyn
{
namespace
{
constexpr int closings_at_most = 10; // as `_CLOSINGS`
} // namespace

ContactSteps::ContactSteps(const Scene & scene, const Candidates & candidates, int rank)
: candidates(candidates), given_(scene), scene_(scene), mechanics_(scene_.model), rows_(scene_.rows)
, floating_(scene_.model), chart_(scene_.model), still_(VectorXd::Zero(scene.model.nv))
, free_(scene_, floating_, mechanics_, rows_, rank), on_joint_(scene.model.njoints, Force::Zero())
{
  ends_.resize(scene.model.nq), q.resize(scene.model.nq);
}

void ContactSteps::begin(const StepPlan & plan, const VectorXd & applied)
{
  plan_ = plan;
  for (int i : scene_.unanchored) // of a motion before
    scene_.constraints[i] = given_.constraints[i];
  free_.begin(plan, applied);
}

void ContactSteps::anchor(const VectorXd & q)
{
  if (scene_.unanchored.empty())
    return;
  mechanics_.place(q);
  condyn::anchor(scene_, mechanics_.data);
}

bool ContactSteps::fits(const VectorXd & q, const VectorXd & v, double closed)
{
  mechanics_.move(q, v, still_);
  rows_.evaluate(scene_, mechanics_.data, q, v, still_);
  candidates.gaps(mechanics_.data, q, gaps_);
  const double deepest = gaps_.size() ? gaps_.minCoeff() : 0.0;
  return std::max(largest(rows_.c), largest(rows_.velocity)) < closed && deepest > -plan_.deep;
}

// ------------------------------------------------------------------------------------------------
// The contacts of a step.

/// The chosen contacts as they are where the step begins.
void ContactSteps::pose()
{
  touching_.along_path = false;
  touching_.eliminate(J_, candidates, free_);
  VectorXd here(touching_.with_gaps), bends = VectorXd::Zero(touching_.with_gaps);
  for (int i = 0; i < touching_.with_gaps; ++i)
    here[i] = gaps_[touching_.chosen[i]];
  // shapes that meet count as straight: at the end of a long step they meet elsewhere
  int over_planes = 0;
  while (over_planes < touching_.problem.cones() && touching_.chosen[over_planes] < candidates.over_planes())
    ++over_planes;
  if (over_planes)
  {
    floating_.integrate(mechanics_, free_.q, plan_.dt * free_.v, ends_);
    mechanics_.place(ends_);
    candidates.heights(mechanics_.data, gap_there_);
    for (int i = 0; i < over_planes; ++i)
      bends[i] = gap_there_[touching_.chosen[i]] - here[i] - plan_.dt * touching_.before[3 * i + 2];
  }
  touching_.ask(here, bends, free_, plan_);
}

bool ContactSteps::solve()
{
  natural = solve_contact(touching_.problem, plan_.method, plan_.solved, touching_.lam);
  if (!(natural <= plan_.solved) || touching_.contradicts(plan_))
    return false;
  if (is_indeterminate(touching_.problem, touching_.lam, plan_.moves, plan_.solved))
    return false;
  touching_.forget_held();
  VectorXd & v1 = touching_.v1;
  v1 = free_.free;
  if (touching_.lam.size())
    v1.noalias() += touching_.X * touching_.lam;
  free_.unwhiten(v1);
  return v1.allFinite();
}

/// With all contacts that the step closes, as they are where it begins.
bool ContactSteps::answer()
{
  const double reach = std::max(plan_.near, 2 * plan_.dt * largest(free_.v));
  Flags active(candidates.count(), 1);
  for (int i = 0; i < candidates.with_gaps(); ++i)
    active[i] = gaps_[i] < reach;
  while (true)
  {
    touching_.choose(active, candidates, plan_);
    if (touching_.chosen.empty())
      free_.condense_at_mean();
    else if (free_.mean != free_.v)
      free_.condense(free_.v);
    pose();
    if (!solve())
      return false;
    bool is_missed = false;
    for (int i = 0; i < candidates.with_gaps(); ++i)
      if (!active[i] && gaps_[i] + plan_.dt * J_.row(candidates.normal(i)).dot(touching_.v1) < 0)
        active[i] = is_missed = true;
    if (!is_missed)
      return true;
  }
}

// ------------------------------------------------------------------------------------------------
// The step.

bool ContactSteps::attempt(const VectorXd & q0, const VectorXd & v0, int step)
{
  step_ = step;
  if (!plan_.path.leads_on(step))
    return false;
  at(step);
  if (!free_.pose(q0, v0))
    return false;
  candidates.gaps(mechanics_.data, q0, gaps_);
  candidates.rows(mechanics_.data, J_);
  if (!answer() || !nearest())
    return false;
  const VectorXd & v1 = touching_.v1;
  a = (v1 - v0) / plan_.dt - free_.turning;
  v = floating_.turned(v1, plan_.dt);
  work << touching_.work(plan_), drive_work();
  floating_.integrate(mechanics_, free_.q, plan_.dt * v1, q);
  at(step + 1);
  if (!close_loops())
    return false;
  return v.allFinite() && std::isfinite(q.squaredNorm() + v1.squaredNorm() + work.sum()) && follows();
}

/// What driven rows did, l_b . (J_b v + J_b v+) / 2.
double ContactSteps::drive_work()
{
  if (!is_driven())
    return 0.0;
  const VectorXd l_b = impulses(), rates = 0.5 * (free_.J() * (free_.v + touching_.v1));
  double all = 0;
  for (int row : plan_.path.rows)
    all += l_b[row] * rates[row];
  return all;
}

/// Whether the loops go where driven rows lead them, and press nothing in that they hold.
bool ContactSteps::follows()
{
  if (!is_driven())
    return true;
  mechanics_.move(q, v, still_);
  rows_.evaluate(scene_, mechanics_.data, q, v, still_);
  if (!(largest(rows_.c) <= plan_.out_of_reach))
    return false;
  candidates.gaps(mechanics_.data, q, gap_there_);
  for (int i = 0; i < touching_.with_gaps; ++i)
  {
    const int n = touching_.problem.normal(i), place = touching_.chosen[i];
    if (touching_.problem.G(n, n) == 0.0 && gap_there_[place] < std::min(-plan_.missed, gaps_[place]))
      return false;
  }
  return true;
}

/// Takes q to where loops are closed, by the factors of the step or, where they are far open, of there; counts the
/// work of that.
bool ContactSteps::close_loops()
{
  closings_made_ = 0;
  if (!free_.blocked.rank)
    return true;
  VectorXd closed = q;
  moved_.resize(q.size());
  const VectorXd open = q;
  double least = INFINITY;
  bool moves = false;
  for (int k = 0; k < closings_at_most; ++k)
  {
    mechanics_.move(q, still_, still_);
    rows_.evaluate(scene_, mechanics_.data, q, still_, still_);
    const double gap = largest(rows_.c);
    if (!(gap < least)) // rounding, or out of reach
      break;
    moves = k > 0, closed = q, least = gap;
    if (closings_made_)
      closings_[closings_made_ - 1].end = q;
    if (gap <= plan_.closed)
      break;
    if (gap > plan_.small)
    {
      if (closings_made_ == int(closings_.size()))
        closings_.push_back({TreeFactor(scene_.model, ties(scene_)), {}, {}, {}});
      Closing & next = closings_[closings_made_++];
      next.begin = next.end = q;
      if (!free_.factorise_at(q, next.factor, next.blocked))
        return false;
    }
    const Closing * by = closings_made_ ? &closings_[closings_made_ - 1] : nullptr;
    const Blocked & blocked = by ? by->blocked : free_.blocked;
    VectorXd along = -(blocked.V * blocked.held(rows_.c));
    (by ? by->factor : free_.factor()).unwhiten(along);
    mechanics_.integrate(q, along, moved_);
    q.swap(moved_);
  }
  q = closed;
  if (moves)
    work[1] += energy(q, v) - energy(open, v);
  return true;
}
} // namespace condyn
