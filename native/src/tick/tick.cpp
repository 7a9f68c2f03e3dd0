#include "tick.hpp"
#include <chrono>
#include <limits>

namespace condyn
{
Tick::Tick(Scene scene, TickSpec spec)
: scene_(std::move(scene)), spec_(std::move(spec)), program_(scene_, spec_), cascade_(spec_), proof_(scene_)
{
  if (!spec_.driven.empty())
    scene_.wanted.setZero(scene_.rows, 3);
}

void Tick::drive(const double * along)
{
  for (int order = 0; order < 3; ++order)
    for (int row : spec_.driven)
      scene_.wanted(row, order) = *along++;
}

TickSizes Tick::operator()(
  const VectorXd & q, const VectorXd & v, const VectorXd & passive, const double * numbers, std::vector<Sides> & sides)
{
  using Clock = std::chrono::steady_clock;
  TickSizes sizes{};
  sizes.kkt = std::numeric_limits<double>::infinity();
  drive(numbers + spec_.numbers);
  if (!program_.at(q, v, passive, numbers))
    return sizes;
  const auto begun = Clock::now();
  sizes.kkt = cascade_.solve(program_.qp, program_.wishes, sides);
  sizes.seconds = std::chrono::duration<double>(Clock::now() - begun).count();
  sizes.changes = cascade_.changes, sizes.answered = cascade_.answered;
  if (!(sizes.kkt <= spec_.kkt))
    return sizes;
  program_.recover(cascade_.x, a, tau, lam, rigid);
  errors = program_.errors(a, lam);
  VectorXd applied = tau + passive;
  for (std::size_t i = 0; i < spec_.rigid.size(); ++i)
    applied[spec_.rigid[i]] += rigid[i];
  const Sizes found = proof_(q, this->v(), applied, a, lam);
  sizes.dynamics = found.dynamics, sizes.constraints = found.constraint, sizes.a = found.a;
  sizes.torque = std::max(largest(program_.terms().h), largest(applied)), sizes.unreached = program_.unreached;
  return sizes;
}
} // namespace condyn
