#pragma once

#include "methods.hpp"

#include <vector>

namespace condyn
{

struct Times
{
  double median_us, p95_us, min_us;
};

/// Times all methods in turns, so that a disturbance of the machine falls on all of them alike.
///
/// Before every timed call the method is run, untimed, at a state with another tau: this warms the
/// caches, and no method can live on what it kept from the same question.
std::vector<Times>
time_in_turns(const std::vector<MethodPtr> & methods, const State & state, int repeats);

} // namespace condyn
