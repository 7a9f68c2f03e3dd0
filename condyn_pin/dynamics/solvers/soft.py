"""Soft: MuJoCo's compliant constraints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from condyn_pin._core._pin import LOCAL, pin
from condyn_pin._core.arguments import Grid
from condyn_pin._core.arrays import Array, finite, ignore_float_errors
from condyn_pin._core.linalg import whiten
from condyn_pin._core.models import whole_data
from condyn_pin._core.threads import one_blas_thread
from condyn_pin.constraints.forces import frame_jacobian
from condyn_pin.dynamics.derivatives.solution_derivatives import Derivatives
from condyn_pin.dynamics.solution import Solution
from condyn_pin.dynamics.solvers.solver import BoundSolver, Singular, Solver, free_force
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import InvalidArgument, InvalidModel
from condyn_pin.model.soundness import massless_motion

# Compliance of MuJoCo's rows: their impedance, and the acceleration that closes a gap.


SolRef = tuple[float, float]
SolImp = tuple[float, float, float, float, float]

# MuJoCo's own.
DEFAULT_SOLREF: SolRef = (0.02, 1.0)
DEFAULT_SOLIMP: SolImp = (0.9, 0.95, 0.001, 0.5, 2.0)


def impedance(gap: Array, solimp: SolImp) -> Array:
    """Return the impedance d [1] at each `gap` >= 0 [m, rad]."""
    # It rises from d_0 where the gap is zero to d_width where it is `width`, steepest at the share
    # `midpoint`, along a polynomial of this power.
    start, end, width, midpoint, power = solimp
    x = np.minimum(gap / width, 1.0)
    below = midpoint * (x / midpoint) ** power
    above = 1 - (1 - midpoint) * ((1 - x) / (1 - midpoint)) ** power
    return np.asarray(start + (end - start) * np.where(x <= midpoint, below, above))


def impedance_slope(gap: Array, solimp: SolImp) -> Array:
    """Return the slope of the impedance at each `gap` >= 0 [1/m, 1/rad]."""
    start, end, width, midpoint, power = solimp
    x = np.minimum(gap / width, 1.0)
    below = power * (x / midpoint) ** (power - 1)
    above = power * ((1 - x) / (1 - midpoint)) ** (power - 1)
    rises = np.where(x <= midpoint, below, above) * (x < 1)
    return np.asarray((end - start) / width * rises)


def reference(c: Array, velocity: Array, d: Array, solref: SolRef, solimp: SolImp) -> Array:
    """Return a_ref = -b J v - k c [m/s^2, rad/s^2], with J v the `velocity`, k of the impedance d.

    b = 2 / (d_width timeconst) and k = d / (d_width timeconst dampratio)^2, or of -stiffness and
    -damping: b = damping / d_width and k = d stiffness / d_width^2.
    """
    (one, two), end = solref, solimp[1]
    if one > 0:
        b, k = 2 / (end * one), d / (end * one * two) ** 2
    else:
        b, k = -two / end, -one * d / end**2
    return np.asarray(-b * velocity - k * c)


def reference_by(
    c: Array, velocity: Array, d: Array, solref: SolRef, solimp: SolImp
) -> tuple[float, Array, Array, Array]:
    """Return b, k, k by d, and a_ref by the two numbers of `solref`, (m, 2)."""
    (one, two), end = solref, solimp[1]
    by_solref = np.empty((len(c), 2))
    if one > 0:
        b, k = 2 / (end * one), d / (end * one * two) ** 2
        by_solref[:, 0] = (b * velocity + 2 * k * c) / one
        by_solref[:, 1] = 2 * k * c / two
    else:
        b, k = -two / end, -one * d / end**2
        by_solref[:, 0], by_solref[:, 1] = d * c / end**2, velocity / end
    return b, k, np.asarray(k / d), by_solref


def check_softness(solref: SolRef, solimp: SolImp) -> tuple[SolRef, SolImp]:
    """Return solref and solimp as tuples of numbers, or refuse them."""
    ref = finite("solref", solref, (2,))
    if not ((ref > 0).all() or (ref < 0).all()):
        raise InvalidArgument(
            f"solref = {solref!r}: (timeconst, dampratio), both > 0, or "
            "(-stiffness, -damping), both < 0"
        )
    start, end, width, midpoint, power = finite("solimp", solimp, (5,)).tolist()
    shares = 0 < start < 1 and 0 < end < 1 and 0 < midpoint < 1
    if not (shares and width > 0 and power >= 1):
        raise InvalidArgument(
            f"solimp = {solimp!r}: (d_0, d_width, width, midpoint, power) with d_0, "
            "d_width and midpoint between 0 and 1, width > 0 and power >= 1"
        )
    one, two = ref.tolist()
    return (one, two), (start, end, width, midpoint, power)


# Soft: MuJoCo's compliant constraints.


# Compliance in decades: 1 - d from 0.1 to 1e-12, the same at every gap.
_STIFFER = tuple((d, d, 0.001, 0.5, 2.0) for d in (1 - float(f"1e-{k}") for k in range(1, 13)))


@dataclass(frozen=True)
class Soft(Solver):
    """MuJoCo's regularised Gauss principle, for constraints that push and pull.

    min over a of |a - a_free|^2_M + |J a + gamma - a_ref|^2_(1/R), which is

    (G + R) lam = a_ref - gamma - J a_free,    a = a_free + M^-1 J^T lam,
    a_ref = -b J v - k c,    R = (1 - d) / d * diag(w),

    with c the gap of a constraint, d its impedance at |c|, and w the mean inverse inertia of its
    two bodies where MuJoCo draws the model, which it takes for the diagonal of G: at the posture
    ``qpos0``, which comes with an MJCF, else at neutral.

    Parameters
    ----------
    solref : (timeconst, dampratio), or (-stiffness, -damping)
        How a gap closes: b = 2 / (d_width timeconst) and k = d / (d_width timeconst dampratio)^2,
        or b = damping / d_width and k = d stiffness / d_width^2 [s, 1; 1/s^2, 1/s].
    solimp : (d_0, d_width, width, midpoint, power)
        d rises from d_0 where the gap is zero to d_width where it is `width` [m, rad], steepest at
        the share `midpoint`, along a polynomial of this power.

    Both defaults are MuJoCo's. For d_0 = d_width -> 1 the answer of a closed state tends to the
    hard one, and is off by a multiple of 1 - d. MuJoCo itself goes no further than d = 0.9999, and
    no faster than a timeconst of two steps.

    Raises
    ------
    InvalidArgument
        If the numbers of `solref` differ in sign, or one of `solimp` is out of its range.

    Notes
    -----
    Cost as `DelassusCholesky`. It solves other equations than the other solvers: lam belongs to a,
    the dynamics hold to rounding, and the constraints do not. The status says inaccurate by as
    much, unless the `accuracy` asked for allows it. `derivatives` are those of its own equations,
    by `solref` too (`SoftDerivatives.by_solref`). Redundant rows share the load. Bodies that are
    fixed to one another weigh as the one that they are here and in what `Robot.to_mjcf` writes;
    MuJoCo weighs each one of an MJCF by itself. A body that only slides, along its principal axes,
    on what is fixed and with nothing on it, is as compliant in MuJoCo as if it were free: by 1 /
    mass, not the mean over three axes, so that w of its rows is up to three times larger there, and
    a differs by a few per cent. A weld that is open turns back as its own rows say, which are
    MuJoCo's where it is closed. gamma is part of it as in MuJoCo 4; MuJoCo 3.3 leaves it out.

    References
    ----------
    Todorov. Convex and analytically-invertible dynamics with contacts and constraints: theory and
    implementation in MuJoCo. ICRA, 2014.
    MuJoCo documentation: Computation, "Constraint model"; Modeling, "Solver parameters".
    """

    title: ClassVar[str] = "Soft"
    cost: ClassVar[str] = "O(n^3 + n^2 m + m^3)"
    use: ClassVar[str] = "to see what MuJoCo sees; not the hard answer"
    takes_redundant: ClassVar[bool] = True
    exact: ClassVar[bool] = False
    sweeps: ClassVar[tuple[Grid, ...]] = ({"solimp": _STIFFER},)

    solref: SolRef = DEFAULT_SOLREF  # [s, 1], or [1/s^2, 1/s]
    solimp: SolImp = DEFAULT_SOLIMP

    def __post_init__(self) -> None:
        super().__post_init__()
        solref, solimp = check_softness(self.solref, self.solimp)
        # lists are welcome; a frozen value is hashed
        object.__setattr__(self, "solref", solref)
        object.__setattr__(self, "solimp", solimp)

    def start(self, workspace: Workspace) -> BoundSolver:
        """Return the regularised problem bound to the equations of `workspace`."""
        # imported here: scipy.linalg takes as long to import as Pinocchio
        from scipy.linalg.lapack import dposv, dtrtrs

        if workspace.drift:
            raise InvalidArgument(
                "drift: Soft pulls its rows back by solref itself; use it without drift"
            )
        w = inverse_inertias(workspace)
        sizes = [bound.size for bound in workspace.bounds]
        starts = [bound.rows.start for bound in workspace.bounds]
        latest, rows = np.zeros(workspace.scene.rows), np.arange(workspace.scene.rows)

        @one_blas_thread
        @ignore_float_errors  # the status says it
        def acceleration(q: Array, v: Array, tau: Array) -> Array:
            equations = workspace.equations
            c = equations.violation(q)
            terms = equations.terms(q, v)
            whitened = whiten(terms.M, terms.J)
            if whitened is None:
                raise Singular
            U, W, G = whitened
            z = dtrtrs(U, free_force(tau, terms.h), trans=1)[0]
            if len(rows):
                gaps = np.sqrt(np.add.reduceat(c * c, starts))
                d = np.repeat(self.impedance(gaps), sizes)
                G[rows, rows] += (1 - d) / d * w
                a_ref = reference(c, terms.J @ v - equations.wanted[1], d, self.solref, self.solimp)
                missing = a_ref - terms.gamma - W.T @ z
                _, latest[:], info = dposv(G, missing)
                if info:
                    raise Singular
                z += W @ latest
            return np.asarray(dtrtrs(U, z)[0])

        return BoundSolver(acceleration, latest.copy, lambda: 1, w)

    def differentiated(
        self, workspace: Workspace, solution: Solution, v: Array, tau: Array
    ) -> Derivatives:
        """Return derivatives of its `solution`, of compliant constraints, at v and tau."""
        from condyn_pin.dynamics.derivatives.others import (
            SoftDerivatives,  # a solve needs none of it
        )

        w = workspace.bound.approximate_delassus
        assert w is not None  # as `start` has made it
        return SoftDerivatives(workspace, solution, v, w, self.solref, self.solimp)

    def impedance(self, gap: Array) -> Array:
        """Return the impedance d at each `gap` >= 0 (m,) [m, rad]."""
        return impedance(gap, self.solimp)


def inverse_inertias(workspace: Workspace) -> Array:
    """Return w (m,): what MuJoCo takes for the diagonal of J M^-1 J^T [1/kg, 1/(kg m^2)]."""
    # For a row between two bodies the sum of how far a force at its centre of mass moves each, or
    # to a moment, the mean over three axes; for a coupling, of what each joint does.
    # imported here: other solvers need no MJCF
    from condyn_pin.io.mjcf_write import drawn_configuration

    model = workspace.model
    data, q = whole_data(model), drawn_configuration(workspace.scene.robot)
    M = np.array(pin.crba(model, data, q))
    pin.computeJointJacobians(model, data, q)

    def gives(J: Array) -> Array:
        whitened = whiten(M, J)
        if whitened is None:
            raise InvalidModel(
                f"Soft needs M at MuJoCo's initial configuration: {massless_motion(model, q)}"
            )
        return np.array(whitened[2].diagonal())

    def body(joint: int) -> Array:
        """Return the inverse inertias of a body (2,) to a force and to a moment, mean over axes."""
        if joint == 0:
            return np.zeros(2)
        at_centre = pin.SE3(np.eye(3), model.inertias[joint].lever)
        six = gives(frame_jacobian(model, data, joint, at_centre, LOCAL))
        return np.asarray(six.reshape(2, 3).mean(axis=1))

    def columns(velocities: Sequence[int]) -> float:
        """Return the sum of the inverse inertias of some velocity entries."""
        return float(gives(np.eye(model.nv)[list(velocities)]).sum())

    w = np.zeros(workspace.scene.rows)
    for bound in workspace.bounds:
        w[bound.rows] = bound.approximate_delassus(body, columns)
    return w
