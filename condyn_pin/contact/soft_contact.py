"""Soft contacts: MuJoCo's compliance and reference acceleration, for the rows of cones."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core.arrays import Array, finite
from condyn_pin.dynamics.solvers.soft import (
    DEFAULT_SOLIMP,
    DEFAULT_SOLREF,
    SolImp,
    SolRef,
    check_softness,
    impedance,
    reference,
)
from condyn_pin.errors import InvalidArgument


class SoftContact(NamedTuple):
    """What makes a ccp of contacts soft, in its rows (t1, t2, n).

    Attributes
    ----------
    R : (3 k,) array
        Compliance [1/kg].
    a_ref : (3 k,) array
        Reference acceleration [m/s^2].
    """

    R: Array  # (3 k,) [1/kg]
    a_ref: Array  # (3 k,) [m/s^2]


def soft_contact(
    gaps: ArrayLike,
    velocities: ArrayLike,
    diagonal: ArrayLike,
    *,
    solref: SolRef = DEFAULT_SOLREF,
    solimp: SolImp = DEFAULT_SOLIMP,
    impratio: float = 1.0,
) -> SoftContact:
    """Return compliance and reference acceleration of contacts as in MuJoCo.

    R_n = (1 - d) / d G_nn,    R_t = R_n / impratio,    a_ref = -b J v - (0, 0, k gap)

    With them, at the level of accelerations, the forces are those of the ccp

    ContactProblem(G, J a_free + gamma - a_ref, friction, R=R, law="ccp", level="acceleration")

    Parameters
    ----------
    gaps : (k,) array_like
        Distance of each contact, negative where bodies overlap [m].
    velocities : (3 k,) array_like
        J v, in the rows (t1, t2, n) [m/s].
    diagonal : (k,) array_like
        G_nn of each contact, or what MuJoCo takes for it, the sum of `body_invweight0` [1/kg].
    solref, solimp : tuple
        As in `condyn_pin.dynamics.Soft`. MuJoCo itself goes no faster than a timeconst of two
        steps.
    impratio : float
        How much stiffer friction is than the normal [1].

    Returns
    -------
    SoftContact

    Raises
    ------
    InvalidArgument
        If sizes do not fit, or a number cannot be used.

    References
    ----------
    MuJoCo documentation: Computation, "Constraint model"; Modeling, "Solver parameters".
    """
    solref, solimp = check_softness(solref, solimp)
    c = finite("gaps", gaps, (np.size(gaps),))
    v = finite("velocities", velocities, (3 * len(c),)).reshape(-1, 3)
    w = finite("diagonal", diagonal, (len(c),))
    if not finite("impratio", impratio, ()) > 0:
        raise InvalidArgument(f"impratio = {impratio!r}: a number > 0 is needed")
    d = impedance(np.abs(c), solimp)
    R = np.repeat((1 - d) / d * w, 3).reshape(-1, 3)
    R[:, :2] /= impratio
    # friction has no gap to close
    gap = np.zeros_like(v)
    gap[:, 2] = c
    a_ref = reference(gap, v, d[:, None], solref, solimp)
    return SoftContact(R.ravel(), a_ref.ravel())
