// Whether a contact problem has several motions, by the tests of `condyn_pin/contact/indeterminacy.py`.
//
//   wedge      z in K, z != 0, G z = 0, g . z = 0, where not all that closes can stick
//   continuum  the equations of modes in which redundant contacts slide leave velocities open
//   Painleve   another answer, where G_nn <= mu |G_nt| of one contact; all contacts that are alone there
//
// The rule that chooses one of them is Python's.
#pragma once
#include "contact_problem.hpp"

namespace condyn
{
/// Whether a problem that lam solves has other answers, which move otherwise.
bool is_indeterminate(const ContactProblem & problem, const VectorXd & lam, double moves, double accuracy);
} // namespace condyn
