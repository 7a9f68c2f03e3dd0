// Impulses of contacts: by one linear system where none slides, else by Newton's method.
#pragma once
#include "contact_problem.hpp"

namespace condyn
{
/// Fills `lam`, and returns its natural residual. What contradicts itself by 1e-6 at most is taken out of g
/// where nothing else helps. What is larger than was asked for, or NaN, has no
/// answer here: Python has other methods to fall back on.
///
/// `sticks_first` says whether contacts that close are first taken to stick, as by Python's `ADMM`.
double solve_contact(ContactProblem & problem, bool sticks_first, double accuracy, VectorXd & lam);
} // namespace condyn
