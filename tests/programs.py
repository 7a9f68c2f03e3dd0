"""Random quadratic programs, feasible and not, and what HiGHS says of them."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog

from condyn_pin.control import QuadraticProgram


def random_program(rng: np.random.Generator) -> QuadraticProgram:
    """About half of them are feasible; every third has a weak Hessian, as programs of control."""
    n = int(rng.integers(3, 15))
    p, r = int(rng.integers(0, n // 2 + 1)), int(rng.integers(1, 3 * n))
    F = rng.normal(size=(n, n)) * (1.0 if rng.integers(3) else 10.0 ** rng.uniform(-2, 1, size=n))
    A, C = rng.normal(size=(p, n)), rng.normal(size=(r, n))
    if p > 1 and rng.integers(4) == 0:
        A[-1] = A[0]  # rows that depend on each other, and mostly contradict
    inside = rng.normal(size=n)
    b = A @ inside if p and rng.integers(4) else rng.normal(size=p)
    middle = C @ inside + rng.normal(size=r) * rng.choice([0.0, 1.0, 4.0])
    width = rng.exponential(size=r)
    lower, upper = middle - width, middle + width
    lower[rng.random(r) < 0.5] = -np.inf
    upper[rng.random(r) < 0.2] = np.inf
    return QuadraticProgram(F.T @ F + 1e-6 * np.eye(n), rng.normal(size=n), A, b, C, lower, upper)


def largest_slack(program: QuadraticProgram) -> float | None:
    """How far all inequalities can be kept from their bounds at once, by HiGHS.

    Negative if the program is infeasible, None if its equations contradict each other.
    """
    above, below = np.isfinite(program.upper), np.isfinite(program.lower)
    G = np.vstack((program.C[above], -program.C[below]))
    most = np.concatenate((program.upper[above], -program.lower[below]))
    n, p = len(program.g), len(program.b)
    found = linprog(
        np.concatenate((np.zeros(n), [-1.0])),
        np.hstack((G, np.ones((len(G), 1)))),
        most,
        np.hstack((program.A, np.zeros((p, 1)))),
        program.b,
        bounds=[(None, None)] * n + [(None, 1.0)],
        method="highs",
    )
    return float(found.x[-1]) if found.status == 0 else None
