// Islands: contacts that feel each other, apart from those that they do not feel.
//
//   i ~ j    if G_ij is not zero
//
// What no impulse of the one does to the other is zero to the last bit, so that nothing is neglected.
#pragma once
#include "contact_problem.hpp"
#include <vector>

namespace condyn
{
/// Contacts of a problem that feel each other and no others: their rows, and the problem that they are by themselves.
struct Island
{
  std::vector<int> rows;
  ContactProblem problem;
};

/// None where all contacts are connected.
std::vector<Island> islands(const ContactProblem & problem);
} // namespace condyn
