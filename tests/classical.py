"""Benchmark problems as their collections print them: M(q) a + G(q)^T lam = f, G a = -g''(q, v).

Written from the test set's text, in whatever precision the arguments have; nothing of the library
is used. `benchmarks/problems.py answers` integrates them, the tests compare scenes with them.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

Array = np.ndarray


class Equations(NamedTuple):
    """The terms of one state; `drift` is what G a has to be."""

    M: Array
    f: Array
    G: Array
    drift: Array


def accelerations(terms: Equations) -> tuple[Array, Array]:
    """Return a and lam of the full-rank system, in the precision of its terms."""
    n, m = len(terms.f), len(terms.drift)
    A = np.zeros((n + m, n + m), dtype=terms.f.dtype)
    A[:n, :n], A[:n, n:], A[n:, :n] = terms.M, terms.G.T, terms.G
    x = eliminate(A, np.concatenate([terms.f, terms.drift]))
    return x[:n], x[n:]


def eliminate(A: Array, b: Array) -> Array:
    """Solve A x = b by Gauss with row pivots, in any precision that numpy has."""
    A, b = A.copy(), b.copy()
    for k in range(len(b)):
        best = k + int(np.argmax(np.abs(A[k:, k])))
        A[[k, best]], b[[k, best]] = A[[best, k]], b[[best, k]]
        factor = A[k + 1 :, k] / A[k, k]
        A[k + 1 :, k:] -= np.outer(factor, A[k, k:])
        b[k + 1 :] -= factor * b[k]
    x = np.zeros_like(b)
    for k in reversed(range(len(b))):
        x[k] = (b[k] - A[k, k + 1 :] @ x[k + 1 :]) / A[k, k]
    return x


# Andrews' mechanism: beta, theta, gamma, phi, delta, omega, epsilon

ANDREWS_ORDER = ("beta", "theta", "gamma", "phi", "delta", "omega", "epsilon")
ANDREWS_START = (
    "-0.0617138900142764496358948458001", "0", "0.455279819163070380255912382449",
    "0.222668390165885884674473185609", "0.487364979543842550225598953530",
    "-0.222668390165885884674473185609", "1.23054744454982119249735015568",
)  # fmt: skip

_NUMBERS = """
    m1 .04325  m2 .00365  m3 .02373  m4 .00706  m5 .07050  m6 .00706  m7 .05498
    xa -.06934  ya -.00227  xb -.03635  yb .03273  xc .014  yc .072  c0 4530
    i1 2.194e-6  i2 4.410e-7  i3 5.255e-6  i4 5.667e-7  i5 1.169e-5  i6 5.667e-7  i7 1.912e-5
    d 28e-3  da 115e-4  e 2e-2  ea 1421e-5  rr 7e-3  ra 92e-5  l0 7785e-5
    ss 35e-3  sa 1874e-5  sb 1043e-5  sc 18e-3  sd 2e-2  ta 2308e-5  tb 916e-5
    u 4e-2  ua 1228e-5  ub 449e-5  zf 2e-2  zt 4e-2  fa 1421e-5  mom 33e-3
"""


_PARAMETERS = dict(zip(*[iter(_NUMBERS.split())] * 2, strict=True))


def andrews_parameters(kind: type = float) -> SimpleNamespace:
    """Return the 42 parameters of the test set as numbers of one kind."""
    return SimpleNamespace(**{name: kind(digits) for name, digits in _PARAMETERS.items()})


def andrews(q: Array, v: Array) -> Equations:
    """Return the seven equations of motion and the six constraints, differentiated twice."""
    c = andrews_parameters(q.dtype.type)
    return Equations(
        _andrews_mass(c, q), _andrews_force(c, q, v), andrews_jacobian(q), _andrews_drift(c, q, v)
    )


def _andrews_mass(c: SimpleNamespace, q: Array) -> Array:
    _, theta, _, phi, _, omega, _ = q
    e, z = c.e - c.ea, c.zf - c.fa
    M = np.zeros((7, 7), dtype=q.dtype)
    M[0, 0] = c.m1 * c.ra**2 + c.i1 + c.i2
    M[0, 0] += c.m2 * (c.rr**2 - 2 * c.da * c.rr * np.cos(theta) + c.da**2)
    M[0, 1] = M[1, 0] = c.m2 * (c.da**2 - c.da * c.rr * np.cos(theta)) + c.i2
    M[1, 1] = c.m2 * c.da**2 + c.i2
    M[2, 2] = c.m3 * (c.sa**2 + c.sb**2) + c.i3
    M[3, 3] = c.m4 * e**2 + c.i4
    M[3, 4] = M[4, 3] = c.m4 * (e**2 + c.zt * e * np.sin(phi)) + c.i4
    M[4, 4] = c.m4 * (c.zt**2 + 2 * c.zt * e * np.sin(phi) + e**2)
    M[4, 4] += c.m5 * (c.ta**2 + c.tb**2) + c.i4 + c.i5
    M[5, 5] = c.m6 * z**2 + c.i6
    M[5, 6] = M[6, 5] = c.m6 * (z**2 - c.u * z * np.sin(omega)) + c.i6
    M[6, 6] = c.m6 * (z**2 - 2 * c.u * z * np.sin(omega) + c.u**2)
    M[6, 6] += c.m7 * (c.ua**2 + c.ub**2) + c.i6 + c.i7
    return M


def _andrews_force(c: SimpleNamespace, q: Array, v: Array) -> Array:
    _, theta, gamma, phi, _, omega, _ = q
    dbeta, dtheta, _, dphi, ddelta, domega, depsilon = v
    e, z = c.e - c.ea, c.zf - c.fa
    x = c.sd * np.cos(gamma) + c.sc * np.sin(gamma)
    y = c.sd * np.sin(gamma) - c.sc * np.cos(gamma)
    dx, dy = x + c.xb - c.xc, y + c.yb - c.yc
    length = np.sqrt(dx**2 + dy**2)
    pull = -c.c0 * (length - c.l0) / length
    coupling = c.m2 * c.da * c.rr * np.sin(theta)
    return np.array(
        [
            c.mom - coupling * dtheta * (dtheta + 2 * dbeta),
            coupling * dbeta**2,
            pull * (x * dy - y * dx),
            c.m4 * c.zt * e * ddelta**2 * np.cos(phi),
            -c.m4 * c.zt * e * dphi * (dphi + 2 * ddelta) * np.cos(phi),
            -c.m6 * c.u * z * depsilon**2 * np.cos(omega),
            c.m6 * c.u * z * domega * (domega + 2 * depsilon) * np.cos(omega),
        ],
        dtype=q.dtype,
    )


def andrews_gap(q: Array) -> Array:
    """Return the six constraints g(q) [m]."""
    c = andrews_parameters(q.dtype.type)
    beta, theta, gamma, phi, delta, omega, epsilon = q
    x = c.rr * np.cos(beta) - c.d * np.cos(beta + theta)
    y = c.rr * np.sin(beta) - c.d * np.sin(beta + theta)
    return np.array(
        [
            x - c.ss * np.sin(gamma) - c.xb,
            y + c.ss * np.cos(gamma) - c.yb,
            x - c.e * np.sin(phi + delta) - c.zt * np.cos(delta) - c.xa,
            y + c.e * np.cos(phi + delta) - c.zt * np.sin(delta) - c.ya,
            x - c.zf * np.cos(omega + epsilon) - c.u * np.sin(epsilon) - c.xa,
            y - c.zf * np.sin(omega + epsilon) + c.u * np.cos(epsilon) - c.ya,
        ],
        dtype=q.dtype,
    )


def andrews_jacobian(q: Array) -> Array:
    """Return G(q) (6, 7)."""
    c = andrews_parameters(q.dtype.type)
    beta, theta, gamma, phi, delta, omega, epsilon = q
    G = np.zeros((6, 7), dtype=q.dtype)
    G[::2, 0] = -c.rr * np.sin(beta) + c.d * np.sin(beta + theta)
    G[1::2, 0] = c.rr * np.cos(beta) - c.d * np.cos(beta + theta)
    G[::2, 1], G[1::2, 1] = c.d * np.sin(beta + theta), -c.d * np.cos(beta + theta)
    G[0, 2], G[1, 2] = -c.ss * np.cos(gamma), -c.ss * np.sin(gamma)
    G[2, 3], G[3, 3] = -c.e * np.cos(phi + delta), -c.e * np.sin(phi + delta)
    G[2, 4] = G[2, 3] + c.zt * np.sin(delta)
    G[3, 4] = G[3, 3] - c.zt * np.cos(delta)
    G[4, 5], G[5, 5] = c.zf * np.sin(omega + epsilon), -c.zf * np.cos(omega + epsilon)
    G[4, 6] = G[4, 5] - c.u * np.cos(epsilon)
    G[5, 6] = G[5, 5] - c.u * np.sin(epsilon)
    return G


def _andrews_drift(c: SimpleNamespace, q: Array, v: Array) -> Array:
    beta, theta, gamma, phi, delta, omega, epsilon = q
    dbeta, dtheta, dgamma, dphi, ddelta, domega, depsilon = v
    both, knee, other = (dbeta + dtheta) ** 2, (dphi + ddelta) ** 2, (domega + depsilon) ** 2
    x = c.rr * np.cos(beta) * dbeta**2 - c.d * np.cos(beta + theta) * both
    y = c.rr * np.sin(beta) * dbeta**2 - c.d * np.sin(beta + theta) * both
    return np.array(
        [
            x - c.ss * np.sin(gamma) * dgamma**2,
            y + c.ss * np.cos(gamma) * dgamma**2,
            x - c.e * np.sin(phi + delta) * knee - c.zt * np.cos(delta) * ddelta**2,
            y + c.e * np.cos(phi + delta) * knee - c.zt * np.sin(delta) * ddelta**2,
            x - c.zf * np.cos(omega + epsilon) * other - c.u * np.sin(epsilon) * depsilon**2,
            y - c.zf * np.sin(omega + epsilon) * other + c.u * np.cos(epsilon) * depsilon**2,
        ],
        dtype=q.dtype,
    )


# Car axis: x and y of the left end, then of the right one; the sign of lam is not the test set's

CAR_AXIS_START = (("0", "0.5", "1", "0.5"), ("-0.5", "0", "-0.5", "0"))


def road(t: float) -> tuple[Array, Array, Array]:
    """Return the end B of the road with its velocity and its acceleration."""
    kind = type(t)
    r, w = kind("0.1"), kind(10)
    y, dy, ddy = r * np.sin(w * t), r * w * np.cos(w * t), -r * w * w * np.sin(w * t)
    x = np.sqrt(1 - y * y)
    dx = -y * dy / x
    ddx = -(dy * dy + y * ddy + dx * dx) / x
    return np.array([x, y]), np.array([dx, dy]), np.array([ddx, ddy])


def car_axis(t: float, p: Array, v: Array) -> Equations:
    """Return the four equations of motion and the two constraints, differentiated twice."""
    kind = p.dtype.type
    mass, rest = kind("5e-4"), kind("0.5")
    B, dB, ddB = road(kind(t))
    left, right, dleft, dright = p[:2], p[2:], v[:2], v[2:]
    stretch, rod, drod = right - B, left - right, dleft - dright
    springs = np.concatenate(
        [
            (rest / np.sqrt(left @ left) - 1) * left,
            (rest / np.sqrt(stretch @ stretch) - 1) * stretch,
        ]
    )
    weight = mass * np.array([0, -1, 0, -1], dtype=p.dtype)
    G = np.array([[*B, kind(0), kind(0)], [*(2 * rod), *(-2 * rod)]], dtype=p.dtype)
    drift = np.array([-2 * (dleft @ dB) - left @ ddB, -2 * (drod @ drod)], dtype=p.dtype)
    return Equations(mass * np.eye(4, dtype=p.dtype), springs + weight, G, drift)


def car_axis_gap(t: float, p: Array) -> Array:
    """Return the two constraints."""
    B, _, _ = road(p.dtype.type(t))
    rod = p[:2] - p[2:]
    return np.array([p[:2] @ B, rod @ rod - 1], dtype=p.dtype)
