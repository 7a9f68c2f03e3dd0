// Whether the answer of a contact problem may be one of several, by tests that cost next to nothing.
//
//   wedge      none where rows are independent, or impulses along all normals open all contacts: S = G e_n,
//              S_n > mu |S_t|; of one in which nothing moves all answers have that motion
//   Painlevé   none of one contact with G_nn > mu |G_nt|
//   continuum  none where nothing slides, or rows that are not open are independent
//
// `condyn_pin/contact/indeterminacy.py` has tests that decide, and the rule that chooses one: what may have several is
// Python's.
#pragma once
#include "contact_problem.hpp"

namespace condyn
{
/// Whether a problem that lam solves may have other answers that move otherwise.
bool may_be_indeterminate(const ContactProblem & problem, const VectorXd & lam, double moves);
} // namespace condyn
