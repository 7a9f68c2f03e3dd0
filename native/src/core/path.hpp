// Where driven rows are to be on the way of a motion, or in one step, as the paths of Python say at each half step:
//
//   c(q) = s(t),    J v = s'(t),    J a + gamma = s''(t)
#pragma once
#include "scene.hpp"
#include <algorithm>
#include <cmath>

namespace condyn
{
struct Path
{
  std::vector<int> rows; // that are driven
  const double * numbers = nullptr; // s, s' and s'' of each, (2 steps + 1, 3, rows)

  /// Takes the driven rows of a scene to where they are to be after so many half steps.
  void put(int halves, Scene & scene) const
  {
    for (std::size_t i = 0; i < rows.size(); ++i)
      for (int order = 0; order < 3; ++order)
        scene.wanted(rows[i], order) = at(halves)[order * rows.size() + i];
  }

  /// Whether the paths have values all through a step.
  bool leads_on(int step) const
  {
    return std::all_of(at(2 * step), at(2 * step + 3), [](double x) { return std::isfinite(x); });
  }

private:
  const double * at(int halves) const { return numbers + 3 * rows.size() * std::size_t(halves); }
};
} // namespace condyn
