// The dual method of Goldfarb and Idnani: from the answer without inequalities, the row that is violated most
// becomes active, and those whose multiplier would change its sign on the way leave.
#include "active_set.hpp"
#include <algorithm>

namespace condyn
{
namespace
{
constexpr double violated = 1e-10; // [m/s^2]
} // namespace

ActiveSet::Violated ActiveSet::most_violated() const
{
  const VectorXd Cx = program_->C.transpose() * x;
  Violated found{-1, between, violated};
  for (Eigen::Index i = 0; i < z.size(); ++i)
  {
    const double below = program_->lower[i] - Cx[i], above = Cx[i] - program_->upper[i];
    if ((*sides_)[i] == between && std::max(below, above) > found.by)
      found = {int(i), below > above ? at_lower : at_upper, std::max(below, above)};
  }
  return found;
}

int ActiveSet::first_to_leave(const VectorXd & rates, double & length) const
{
  int found = -1;
  for (std::size_t i = 0; i < active_.size(); ++i)
  {
    const Side side = (*sides_)[active_[i]];
    const double rate = rates[equations_ + i] * side, left = std::max(multipliers_[equations_ + i] * side, 0.0);
    if (rate < 0 && left < -rate * length)
      length = left / -rate, found = int(i);
  }
  return found;
}

bool ActiveSet::dual()
{
  std::fill(sides_->begin(), sides_->end(), between);
  x.setZero(), z.setZero(), multipliers_.setZero();
  gather();
  refine();
  Violated it = most_violated();
  for (int left = 10 * int(z.size() + x.size()); it.row >= 0; --left)
  {
    int leaves = -1;
    if (!left || !x.allFinite() || !step(it, leaves))
      return false;
    ++changes;
    if (leaves < 0)
    {
      refine(); // what steps have rounded
      it = most_violated();
      continue;
    }
    for (std::size_t i = 0; i < active_.size(); ++i)
      z[active_[i]] = multipliers_[equations_ + i];
    (*sides_)[active_[leaves]] = between, z[active_[leaves]] = 0;
    gather();
  }
  return true;
}

bool ActiveSet::step(Violated & it, int & leaves)
{
  const auto c = program_->C.col(it.row);
  VectorXd whole = -it.side * c, shares;
  forward(whole);
  VectorXd along = whole;
  take_out(along, shares);
  // how fast it comes to its bound; not at all where it depends on the active ones, of which one has to leave
  const bool moves = along.norm() > dependent * whole.norm();
  const double slope = moves ? along.squaredNorm() : 0.0;
  const auto R = R_.topLeftCorner(count_, count_).triangularView<Eigen::Upper>();
  const VectorXd rates = R.solve(shares);
  double length = moves ? it.by / slope : none;
  leaves = first_to_leave(rates, length);
  if (length == none)
    return false;
  if (moves)
  {
    backward(along);
    x += length * along;
  }
  multipliers_.head(count_) += length * rates;
  z[it.row] += it.side * length;
  if (leaves >= 0)
  {
    it.by = std::max(0.0, it.by - length * slope);
    return true;
  }
  (*sides_)[it.row] = it.side;
  return activate(it.row, it.side, -double(it.side) * whole);
}
} // namespace condyn
