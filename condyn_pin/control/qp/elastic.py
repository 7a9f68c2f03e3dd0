"""The elastic program: what has to give where rows contradict each other.

With t >= 0 for the rows that may give, in order of how readily they do,

    min  sum_i c_i t_i    with    A x = b,    lower - t <= C x <= upper + t.

t = 0 proves that the program is feasible. Else rows with t > 0 give, and rows that stand against
them are those with a multiplier. A linear program, answered by HiGHS: no solver of quadratic
programs has a part in it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.control.qp.quadratic_program import QuadraticProgram


@dataclass(frozen=True, eq=False)
class Elastic:
    """What the rows of a program have to give.

    Attributes
    ----------
    x : (n,) array
        A point where they give no more than that.
    of_equations, of_inequalities : (p,), (r,) array
        What each gives.
    against_equations, against_inequalities : (p,), (r,) array
        Multipliers: what giving would save, of rows that stand in the way.
    """

    x: Array
    of_equations: Array
    of_inequalities: Array
    against_equations: Array
    against_inequalities: Array


def elastic(
    program: QuadraticProgram, equations: Array, inequalities: Array, *, most: int | None = None
) -> Elastic | None:
    """Return what rows have to give at least; None if HiGHS does not say.

    Parameters
    ----------
    program : QuadraticProgram
    equations, inequalities : (p,), (r,) array
        The cost c of a row for what it gives; infinite for rows that never give.
    most : int, optional
        Iterations of HiGHS; its own limit by default.
    """
    # imported here: scipy.optimize takes as long to import as Pinocchio
    from scipy.optimize import linprog

    n, p, r = len(program.g), len(program.b), len(program.lower)
    soft_A, soft_C = np.isfinite(equations), np.isfinite(inequalities)
    s_A = np.eye(p)[:, soft_A]
    s_C = np.eye(r)[:, soft_C]
    k, m = s_A.shape[1], s_C.shape[1]
    above, below = np.isfinite(program.upper), np.isfinite(program.lower)
    G = np.vstack((
        np.hstack((program.C, np.zeros((r, 2 * k)), -s_C))[above],
        np.hstack((-program.C, np.zeros((r, 2 * k)), -s_C))[below],
    ))  # fmt: skip
    above_all = np.concatenate((program.upper[above], -program.lower[below]))
    A = np.hstack((program.A, s_A, -s_A, np.zeros((p, m))))
    cost = np.concatenate((np.zeros(n), equations[soft_A], equations[soft_A], inequalities[soft_C]))
    free = [(None, None)] * n + [(0.0, None)] * (2 * k + m)
    found = linprog(
        cost, G, above_all, A, program.b, bounds=free, method="highs-ds",
        options={} if most is None else {"maxiter": most},
    )  # fmt: skip
    if found.status != 0:
        return None
    t = found.x[n:]
    gives_A, gives_C = np.zeros(p), np.zeros(r)
    gives_A[soft_A] = t[:k] + t[k : 2 * k]
    gives_C[soft_C] = t[2 * k :]
    against_C = np.zeros(r)
    marginals = np.abs(found.ineqlin.marginals)
    against_C[above] += marginals[: int(above.sum())]
    against_C[below] += marginals[int(above.sum()) :]
    return Elastic(
        np.array(found.x[:n]), gives_A, gives_C, np.abs(found.eqlin.marginals), against_C
    )
