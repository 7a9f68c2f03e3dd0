// Newton's method on the natural map of a normalised problem.
#pragma once
#include "natural_map.hpp"

namespace condyn
{
class Newton
{
public:
  explicit Newton(const ContactProblem & problem) : map_(problem) {}

  /// Where it ends, from impulses.
  VectorXd run(VectorXd lam, int steps_at_most) const;

private:
  using Point = NaturalMap::Point;

  bool descend(VectorXd & lam, const VectorXd & step, Point & point) const;
  bool until_one_changes(VectorXd & lam, Point & point, const MatrixXd & D) const;
  double first_change(const Point & point, const VectorXd & y) const;

  NaturalMap map_;
};
} // namespace condyn
