"""Compute the digits of `benchmarks/lab/problems` that no closed form gives, in extended precision.

    python benchmarks/problem_answers.py [A03] [car_axis]

The equations are those of the literature (`tests/classical.py`), not the library's. They are
integrated by Gragg's midpoint rule with extrapolation, with several steps and orders, with and
without projection onto the constraints; what all of them agree in is printed. Where long double is
double (not on x86), the agreement shows it. A minute or two.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))

import classical

Long = np.longdouble
Array = np.ndarray
Rate = Callable[[Long, Array], Array]


def extrapolated_step(rate: Rate, t: Long, y: Array, h: Long, order: int) -> Array:
    """Return y at t + h: midpoint rules of 2, 4, ... substeps, extrapolated in their square."""
    counts = [2 * (k + 1) for k in range(order // 2)]
    start, above = rate(t, y), []
    for j, count in enumerate(counts):
        small = h / Long(count)
        before, now = y, y + small * start
        for k in range(1, count):
            before, now = now, before + 2 * small * rate(t + k * small, now)
        row = [(before + now + small * rate(t + h, now)) / 2]
        for k in range(j):
            ratio = (Long(count) / Long(counts[j - k - 1])) ** 2
            row.append(row[k] + (row[k] - above[k]) / (ratio - 1))
        above = row
    return above[-1]


def integrate(
    rate: Rate, y: Array, until: str, steps: int, order: int, project: Callable | None
) -> Array:
    """Return y at the end of equal steps from t = 0."""
    h = Long(until) / Long(steps)
    for k in range(steps):
        y = extrapolated_step(rate, k * h, y, h, order)
        if project:
            y = project((k + 1) * h, y)
    return y


def andrews_rate(t: Long, y: Array) -> Array:
    """Return q' and v' of Andrews' mechanism."""
    a, _ = classical.accelerations(classical.andrews(y[:7], y[7:]))
    return np.concatenate([y[7:], a])


def andrews_projected(t: Long, y: Array) -> Array:
    """Return the state moved onto the constraints."""
    q, v = y[:7].copy(), y[7:]
    for _ in range(2):
        q -= least(classical.andrews_jacobian(q), classical.andrews_gap(q))
    G = classical.andrews_jacobian(q)
    return np.concatenate([q, v - least(G, G @ v)])


def car_axis_rate(t: Long, y: Array) -> Array:
    """Return p' and v' of the car axis."""
    a, _ = classical.accelerations(classical.car_axis(t, y[:4], y[4:]))
    return np.concatenate([y[4:], a])


def car_axis_projected(t: Long, y: Array) -> Array:
    """Return the state moved onto the constraints."""
    p, v = y[:4].copy(), y[4:]
    for _ in range(2):
        p -= least(classical.car_axis(t, p, v).G, classical.car_axis_gap(t, p))
    G = classical.car_axis(t, p, v).G
    _, dB, _ = classical.road(t)
    return np.concatenate([p, v - least(G, G @ v + np.array([p[:2] @ dB, 0], dtype=Long))])


def least(G: Array, gap: Array) -> Array:
    """Return the smallest x with G x = gap."""
    return G.T @ classical.eliminate(G @ G.T, gap)


def numbers(digits: tuple[str, ...]) -> Array:
    """Return digits as extended numbers."""
    return np.array([Long(each) for each in digits])


CASES = {
    "A03": (
        andrews_rate,
        andrews_projected,
        np.concatenate([numbers(classical.ANDREWS_START), np.zeros(7, dtype=Long)]),
        (("0.03", 300), ("0.05", 500)),
        7,
    ),
    "car_axis": (
        car_axis_rate,
        car_axis_projected,
        np.concatenate([numbers(part) for part in classical.CAR_AXIS_START]),
        (("3", 300),),
        4,
    ),
}


def main() -> None:
    """Print the digits, and what the settings agree to."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("problems", nargs="*", default=list(CASES), help=", ".join(CASES))
    for name in parser.parse_args().problems:
        rate, project, start, ends, size = CASES[name]
        for until, steps in ends:
            found = [
                integrate(rate, start, until, steps, 16, None)[:size],
                integrate(rate, start, until, 2 * steps, 14, None)[:size],
                integrate(rate, start, until, steps, 18, project)[:size],
            ]
            spread = max(float(np.abs(each / found[-1] - 1).max()) for each in found[:-1])
            print(f"{name} at {until} s, three settings agree to {spread:.1e}:")
            for each in found[-1]:
                print(f"    {np.format_float_scientific(each, precision=18)}")


if __name__ == "__main__":
    main()
