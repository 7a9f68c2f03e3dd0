"""Terms: what the equations of a scene are made of at one state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from condyn_pin._core.arrays import Array, check_overflow

if TYPE_CHECKING:
    from condyn_pin.constraints.rows.equations import Equations
    from condyn_pin.constraints.rows.redundancy import LeftOut


@dataclass(frozen=True, eq=False)
class Terms:
    """The terms of the two equations at one state.

    M a + h = tau + J^T lam,    J a + gamma = a_ref

    Attributes
    ----------
    M : (nv, nv) array
        Mass matrix, armature included, both triangles.
    h : (nv,) array
        Coriolis, centrifugal and gravity torques [N m, N].
    J : (m, nv) array
        Constraint Jacobian, rows in the order of the scene, in the axes of each constraint.
    gamma : (m,) array
        Jdot v where J v = 0; for points and balls the classical acceleration elsewhere.
    a_ref : (m,) array
        Wanted acceleration of the constraints; zero without drift control.
    """

    M: Array
    h: Array
    J: Array
    gamma: Array
    a_ref: Array

    def __init__(self, M: Array, h: Array, J: Array, gamma: Array, a_ref: Array) -> None:
        # at once: the guarded assignments of a frozen dataclass take twice as long
        self.__dict__.update(M=M, h=h, J=J, gamma=gamma, a_ref=a_ref)

    def kept(self, left: LeftOut) -> Terms:
        """The terms without some combinations of rows.

        Parameters
        ----------
        left : LeftOut
            What is left out at their state.
        """
        J, gamma, a_ref = (left.kept(part) for part in (self.J, self.gamma, self.a_ref))
        return Terms(self.M, self.h, J, gamma, a_ref)


def largest_torque(terms: Terms, tau: Array, size: float) -> float:
    """Return the largest |M| size + |h| + |tau| of a joint [N, N m]: what forces are compared with.

    `size` is that of a: the larger of |a|_inf and gravity.
    """
    torques = np.abs(terms.M).sum(axis=1) * size + np.abs(terms.h) + np.abs(tau)
    return float(torques.max())


def finite_terms(equations: Equations, q: Array, v: Array) -> Terms:
    """Return the terms at a state that was checked; InvalidArgument if v makes them overflow."""
    with np.errstate(all="ignore"):  # what overflows is refused
        terms = equations.terms(q, v)
    check_overflow("v", v, terms.h, terms.gamma, terms.a_ref)
    return terms
