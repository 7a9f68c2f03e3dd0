"""The work of the contacts in a step, each part by its cause.

    W = lam . w,    w = (J_c v + J_c v+) / 2

is what impulses do to the kinetic energy. With p, at which a step pushes out, lam_n p / 2 of it is
there only because a gap was negative, and so is lam_n (J_n v) / 2 where such a contact still moves
out as the step before has left it: `correction`.

The rest has a sign. Impulses act against velocities: lam . (J_c v+) is -mu |lam_n| |sigma_t| of
friction and -lam_n gap / dt of gaps that close, and what they change them by is lost. But they
act along J of one place of a step, for velocities at its end. Where paths bend, or what moves comes
to rest and is held within the step, W may be positive: such a step gives what no contact would.
That is `algorithmic`, and goes to zero with dt. What Newton's law of restitution may give where
several contacts meet with friction is in it too, and does not.
"""

from __future__ import annotations

import numpy as np

from condyn_pin._core.arrays import Array, Indices
from condyn_pin.simulation.contact_work import NO_WORK, ContactWork
from condyn_pin.simulation.integrators.contact_scheme import (
    AT_REST,
    ContactScheme,
    Near,
)
from condyn_pin.simulation.integrators.posed import Posed


def step_work(scheme: ContactScheme, posed: Posed, lam: Array, v1: Array) -> ContactWork:
    """Return what impulses lam (m,) did in a step that has led to v+ (nv,).

    Contacts that give way do work of either sign, as springs: all of it is `contact`.
    """
    if not len(lam):
        return NO_WORK
    near = posed.near
    work = 0.5 * float(lam.dot(near.before + posed.J_c.dot(v1)))
    if scheme.gives_way:
        return ContactWork(work, 0.0, 0.0)
    correction = _pushing_out(near, lam, work) if scheme.closes_gaps else 0.0
    rest = work - correction
    return ContactWork(min(rest, 0.0), correction, max(rest, 0.0))


def drive_work(posed: Posed, lam: Array, rows: Indices) -> float:
    """Return what driven `rows` of the constraints did in a step with impulses lam (m,) [J].

    l_b . (J_b v + J_b v+) / 2,    J_b = U S V^T L^T
    """
    condensed = posed.condensed
    factors, r = condensed.factors, condensed.factors.rank
    moved = factors.V.T.dot(posed.v.dot(factors.L)) + condensed.held
    rates = (factors.U[rows, :r] * factors.S[:r]).dot(moved)
    return 0.5 * float(condensed.constraint_impulses(lam)[rows].dot(rates))


def _pushing_out(near: Near, lam: Array, work: float) -> float:
    """Return the part of work that is there only because gaps were negative [J]."""
    if min(near.gaps.tolist(), default=0.0) >= -AT_REST:
        return 0.0
    rates = near.allowed / near.dt  # -p
    deep = rates < 0.0
    lam_n, before = lam[near.normals][deep], near.before[near.normals][deep]
    now = -0.5 * float(lam_n.dot(rates[deep]))
    left = 0.5 * float(lam_n.dot(np.maximum(before, 0.0)))
    return now + min(left, max(work - now, 0.0))
