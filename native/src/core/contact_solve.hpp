// Impulses of contacts, as Python's `ADMM` and `SemismoothNewton` find them, and what is tried next.
//
//   sticking, where no contact slides;   alternating directions, or Newton's method;   the other one from there
#pragma once
#include "admm.hpp"
#include "contact_problem.hpp"

namespace condyn
{
/// How a contact problem is answered.
struct ContactMethod
{
  bool alternates; // as `ADMM` does; else there is Newton's method alone
  bool newton_first; // whether directions are what is tried where Newton's method fails
  bool sticks_first; // whether contacts that close are first taken to stick
  int polish; // steps of Newton's method that end it
  Directions directions;
  int steps; // of Newton's method where nothing is known of the answer
};

/// Fills `lam`, and returns its natural residual. What contradicts itself by 1e-6 at most is taken out of g
/// where nothing else helps. What is larger than was asked for, or NaN, has no
/// answer here: Python has other methods to fall back on.
double solve_contact(ContactProblem & problem, const ContactMethod & method, double accuracy, VectorXd & lam);
} // namespace condyn
