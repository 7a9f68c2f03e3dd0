#include "islands.hpp"
#include <algorithm>
#include <numeric>

namespace condyn
{
namespace
{
/// The first row of a contact, and how many it has.
std::pair<int, int> block(const ContactProblem & problem, int contact)
{
  if (contact < problem.cones())
    return {3 * contact, 3};
  return {problem.lines() + contact - problem.cones(), 1};
}

/// For each contact the smallest number of those that it is connected to.
std::vector<int> labels(const ContactProblem & problem, int count)
{
  std::vector<int> label(count), waiting;
  std::iota(label.begin(), label.end(), 0);
  std::vector<bool> seen(count, false);
  for (int first = 0; first < count; ++first)
  {
    if (seen[first])
      continue;
    seen[first] = true, waiting = {first};
    while (!waiting.empty())
    {
      const int i = waiting.back();
      waiting.pop_back();
      label[i] = first;
      const auto [at_i, rows_i] = block(problem, i);
      for (int j = 0; j < count; ++j)
      {
        const auto [at_j, rows_j] = block(problem, j);
        if (!seen[j] && (problem.G.block(at_i, at_j, rows_i, rows_j).array() != 0).any())
          seen[j] = true, waiting.push_back(j);
      }
    }
  }
  return label;
}

Island island(const ContactProblem & whole, const std::vector<int> & contacts)
{
  Island made;
  std::vector<double> friction, limits;
  for (int contact : contacts)
  {
    const auto [at, rows] = block(whole, contact);
    for (int r = at; r < at + rows; ++r)
      made.rows.push_back(r);
    if (contact < whole.cones())
      friction.push_back(whole.friction[contact]);
    else if (at < whole.dry())
      ++made.problem.half_lines;
    else
      limits.push_back(whole.limits[at - whole.dry()]);
  }
  made.problem.G = whole.G(made.rows, made.rows), made.problem.g = whole.g(made.rows);
  made.problem.friction = Eigen::Map<const VectorXd>(friction.data(), friction.size());
  made.problem.limits = Eigen::Map<const VectorXd>(limits.data(), limits.size());
  return made;
}
} // namespace

std::vector<Island> islands(const ContactProblem & problem)
{
  const int count = problem.cones() + problem.rows() - problem.lines();
  if (count < 2 || (problem.G.array() != 0).all())
    return {};
  const std::vector<int> label = labels(problem, count);
  if (std::all_of(label.begin(), label.end(), [](int each) { return each == 0; }))
    return {};
  std::vector<Island> found;
  for (int first = 0; first < count; ++first)
  {
    std::vector<int> its;
    for (int i = first; i < count; ++i)
      if (label[i] == first)
        its.push_back(i);
    if (!its.empty())
      found.push_back(island(problem, its));
  }
  return found;
}
} // namespace condyn
