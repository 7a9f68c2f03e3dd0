"""Nominal state of a scene: rank, scales, and the estimator of errors from residuals.

A solve needs M, J and their factors at one state: the first posture as it is, where that closes
the loops. Only a posture that leaves them open is assembled first, and one where M is singular, or
nearly, is left for another one near it: what is measured there says nothing of other states. All
else is measured when it is first asked for.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import normalised
from condyn_pin._core.arrays import Array, read_only
from condyn_pin._core.linalg import (
    MassFactor,
    MinimumNorm,
    factorise_mass,
    factorise_rows,
    redundant_rows,
    whiten,
)
from condyn_pin._core.threads import one_blas_thread
from condyn_pin.constraints.rows.bound import Terms, largest_torque
from condyn_pin.constraints.rows.equations import (
    ROUNDED,
    Equations,
    MassConditioning,
    least_of,
    more_than,
)
from condyn_pin.constraints.rows.pinocchio import PinocchioConstraints, pinocchio_constraints
from condyn_pin.dynamics.residuals import ErrorEstimator
from condyn_pin.dynamics.solvers.reference import Reference
from condyn_pin.dynamics.solvers.solver import Solver
from condyn_pin.errors import (
    BranchChanged,
    InvalidArgument,
    InvalidModel,
    NotAssembled,
    unknown_name,
)
from condyn_pin.model.robot import Robot
from condyn_pin.model.soundness import massless_motion, singular_mass

if TYPE_CHECKING:
    from condyn_pin.constraints.rows.redundancy import Redundancy
    from condyn_pin.dynamics.digits import Digits
    from condyn_pin.dynamics.scene import Scene


# How far joints are moved to open loops [rad, m].
_APART = 1e-3

# Where M is singular at the nominal state: how far others are from it [rad, m], and how many.
_AWAY = 0.5
_TRIES = 10

# Share of the largest singular value in the metric of M above which none is small in scaled units,
# as digits of a file make them: light bodies make the two differ by tens.
_CLEAR = 0.1

_OF = "_at_any_time"  # where a scene at a time has the one that it is at all times
_DIGITS = "_digits"  # where a scene has what the digits of its file make up, once that is known


def scene_without_time(scene: Scene) -> Scene:
    """Return the scene at all times that a scene at one time was made from, if that closes."""
    # Its J, and the rank of that, are those of the scene at one time. Otherwise the scene itself.
    of: Scene = vars(scene).get(_OF, scene)
    return of if of is scene or of.nominal.closed else scene


def digits_of(scene: Scene) -> Digits | None:
    """Spurious rank of a scene from the numbers of its file; None if unknown so far."""
    found: Digits | None = vars(scene_without_time(scene).bilateral).get(_DIGITS)
    return found


def look_at_digits(
    scene: Scene, rows: Equations, q: Array, J: Array | None = None
) -> Digits | None:
    """Look once for spurious rank from the numbers of a scene's file, at a state (`digits_at`)."""
    from condyn_pin.dynamics.digits import digits_at  # most scenes have clear values

    known = vars(scene_without_time(scene).bilateral)
    if _DIGITS not in known:
        known[_DIGITS] = digits_at(scene, rows, q, J=J)
    return digits_of(scene)


def scene_at(scene: Scene, of: Scene) -> Scene:
    """Return a scene at one time, marked as a copy of the scene `of` at all times."""
    vars(scene)[_OF] = vars(of).get(_OF, of)
    return scene


class NominalAnalysis:
    """Rank, conditioning and redundant rows of a scene at its nominal state.

    Parameters
    ----------
    scene : Scene
    equations : Equations
        Of the scene, without drift control. They are used here and not kept: their memory takes
        longer to make than to use, and that of a long chain is large.

    Attributes
    ----------
    q : (nq,) array
        The nominal state: the first posture, or neutral, with the loops closed; where M is singular
        there, a closed state near it where M is not.
    closed : bool
        Whether the loops could be closed; if not, all figures are those of the open state.
    terms : Terms
        M, h, J and gamma at q, at rest.
    factors : MinimumNorm
        Of M and J, without the singular values that rounding makes up.
    cancellation : (m, nv) array
        What the two bodies of a row bring to J before they cancel [1, m].
    rank, mobility : int
        Independent rows; degrees of freedom that are left, nv minus the rank.
    dependent : bool
        Whether there are redundant rows.
    idle : (m,) array of bool
        Rows that are zero at every configuration, as the one across the plane of a planar loop.
    rounded : bool
        Whether rows that are zero are so but for rounding, as in a slanted plane's loop.
    digits : Digits or None
        What the digits of the file make up, if that is anything: rows that it makes count are
        left out of J and its factors.
    gravity, weight : float
        |g| [m/s^2]; mass times gravity, or mass times 1 m/s^2 without gravity [N].
    measured : dict of Solver to tuple
        What a solver has measured on the scene, so that its next workspace need not.
    """

    @one_blas_thread
    def __init__(self, scene: Scene, equations: Equations) -> None:
        self._scene, robot = scene, scene.robot
        self.measured: dict[Solver, tuple[float, int, int]] = {}
        self.q, self.closed, mass = _nominal_mass(scene, equations)
        self.cancellation = P = equations.cancellation(self.q)
        M, h, J, gamma = equations.parts(self.q, np.zeros(robot.nv))
        self.terms = Terms(M, h, more_than(least_of(P), J), gamma, equations.a_ref())
        factors = factorise_rows(mass, self.terms.J, tolerances.RANK)
        if self.closed and _may_be_rounded(factors.S):
            look_at_digits(scene, equations, self.q, self.terms.J)
        self.digits = digits_of(scene)
        if rounded := self.rounded_file:
            left = rounded.left_out_by_digits(self.terms.J)
            if left is not None:
                self.terms = self.terms.kept(left)
                factors = factorise_rows(mass, self.terms.J, tolerances.RANK).at_most(left.rank)
        self.factors = factors.above_rounding(self.cancellation)
        self.rank = self.factors.rank
        self.mobility, self.dependent = robot.nv - self.rank, self.rank < scene.rows
        # independent rows do not all but vanish a thousandth of a radian away
        self.idle, self.rounded = np.zeros(scene.rows, dtype=bool), False
        if self.dependent:
            self.idle, self.rounded = _idle_rows(equations, self.q, self.cancellation)
        self._lively = scene.rows - int(np.count_nonzero(self.idle))
        self.gravity = float(np.linalg.norm(robot.model.gravity.linear))
        self.weight = robot.mass * (self.gravity or 1.0)
        read_only((self.q, self.terms, self.factors, self.factors.weights, self.cancellation))

    @property
    def rounded_file(self) -> Redundancy | None:
        """The redundancy, if digits of the file hide it: then rows are left out at any state."""
        return self.digits.redundancy if self.digits else None

    @property
    def singular_values(self) -> Array:
        """Singular values of J L^-T (min(m, nv),), the Jacobian in the metric of M [kg^-1/2]."""
        return self.factors.S

    @cached_property
    def redundant(self) -> tuple[str, ...]:
        """Rows that can go without changing the motion, as ``constraint.axis``."""
        return redundant_rows(self.factors.U[:, self.rank :], self._scene.row_names)

    @property
    def every_row_counts(self) -> bool:
        """True if all rows are independent, but for those that stay zero on open loops."""
        return self.rank >= self._lively

    @property
    def independent(self) -> bool:
        """True if Pinocchio's rows are independent: two points for a hinge have one too many."""
        return self.every_row_counts and not pinocchio_constraints_of(self._scene).approximated

    @property
    def looks_independent(self) -> bool:
        """True if rows that are redundant on closed loops look independent on open ones."""
        return not self.every_row_counts and self._scene.robot.precision > 0.0

    @cached_property
    @one_blas_thread
    def redundancy(self) -> Redundancy:
        """Redundancy of the rows, for states that leave the loops open."""
        from condyn_pin.constraints.rows.redundancy import Redundancy  # closed loops need none

        if self.rounded_file:
            return self.rounded_file
        rows = Equations(self._scene.robot.unedited, self._scene.bounds)
        rank = self.rank if self.every_row_counts else None
        return Redundancy.of(rows, self.q, self.cancellation, rank, self.closed)

    @property
    def condition(self) -> float:
        """Condition number of the mass matrix."""
        return self.factors.mass.condition

    @property
    def delassus_norm(self) -> float:
        """Largest eigenvalue of G = J M^-1 J^T [1/kg]; 1/mass without constraints."""
        return float(self.factors.S[0] ** 2) if self.rank else 1 / self._scene.robot.mass

    @cached_property
    @one_blas_thread
    def delassus_spectrum(self) -> tuple[float, float]:
        """Largest and smallest nonzero eigenvalue of G with the rows that Pinocchio has [1/kg].

        With lam = E^T lam_native and J L^-T = U S V^T these are the squares of the singular values
        of E U S. Rows that Pinocchio does not have stay as they are.
        """
        native, rank = pinocchio_constraints_of(self._scene), self.rank
        if not rank:
            return self.delassus_norm, self.delassus_norm
        E_, S = native.to_scene, self.factors.S[:rank]
        if E_ is not None and not native.unsupported:
            U = self.factors.U[:, :rank]
            S = np.asarray(np.linalg.svd(E_.T @ (U * S), compute_uv=False), float)
        return float(S[0] ** 2), float(S[rank - 1] ** 2)

    @property
    def delassus_condition(self) -> float:
        """Condition number of G as Pinocchio has it, but for redundant rows."""
        largest, smallest = self.delassus_spectrum
        return largest / smallest

    @cached_property
    @one_blas_thread
    def estimator(self) -> ErrorEstimator:
        """Estimator of the error of a from residuals."""
        leaning = [
            row
            for b in self._scene.bounds
            if b.has_computed_axes
            for row in range(b.rows.start, b.rows.stop)
        ]
        return ErrorEstimator(self.factors, self.cancellation, self.gravity, self.weight, leaning)

    @cached_property
    def pivots(self) -> MassConditioning:
        """Pivots of M that may be far less elsewhere."""
        return MassConditioning(self._scene.robot.least_pivots, self.factors.mass.pivots)

    @cached_property
    @one_blas_thread
    def states(self) -> tuple[NominalState, ...]:
        """Two states at q: at rest, and moving along the constraints under random torques."""
        equations = Equations(self._scene.robot.unedited, self._scene.bounds)
        return read_only(nominal_states(equations, self.q, self.factors, self.cancellation))

    @one_blas_thread
    def whitened_rows(self) -> Array:
        """Return J L^-T (m, nv), the Jacobian in the metric of M."""
        whitened = whiten(self.terms.M, self.terms.J)
        if whitened is None:
            said = massless_motion(self._scene.robot.model, self.q)
            raise InvalidModel(said or "the mass matrix is not positive definite")
        return np.asarray(whitened[1].T)


def pinocchio_constraints_of(scene: Scene) -> PinocchioConstraints:
    """Return the constraints of a scene as Pinocchio's own methods take them; made once."""
    # Scenes that differ by anchors share a `NominalAnalysis`, but not these.
    known = vars(scene)
    if "_pinocchio_constraints" not in known:
        known["_pinocchio_constraints"] = pinocchio_constraints(
            scene.robot.model, scene.bounds, lambda: scene.nominal.whitened_rows()
        )
    found: PinocchioConstraints = known["_pinocchio_constraints"]
    return found


def _nominal_configuration(scene: Scene, equations: Equations) -> tuple[Array, bool]:
    """Return q of the nominal state, and whether the loops are closed there."""
    q = normalised(scene.robot.model, "posture", described_posture(scene))
    rows = [row for bound in scene.bounds for row in bound.positioned]
    if not rows or np.linalg.norm(equations.violation(q)[rows]) <= tolerances.CLOSED:
        return q, True
    try:
        return scene.closed_posture(), True
    except BranchChanged as error:
        return error.assembly.q, True
    except NotAssembled:
        return described_posture(scene), False


def _nominal_mass(scene: Scene, equations: Equations) -> tuple[Array, bool, MassFactor]:
    """Return q of the nominal state, whether the loops are closed there, and the factor of M."""
    # Where M is singular or nearly so, they are those of the first of some random states near it
    # that will do; if none will, those of the state in which joints feel most inertia. InvalidModel
    # if M is singular at all of them.
    robot, error, most = scene.robot, None, -1.0
    for q, closed in _configurations(scene, *_nominal_configuration(scene, equations)):
        try:
            mass = _mass_factor(robot, q, equations.mass(q))
        except InvalidModel as found:
            error = error or found
            continue
        share = _least_share(robot, mass)
        if share > most:
            most, best = share, (q, closed, mass)
        if share >= tolerances.WELL_MOVED:
            break
    if most < 0.0:
        assert error is not None
        raise error
    return best


def _configurations(scene: Scene, q: Array, closed: bool) -> Iterator[tuple[Array, bool]]:
    """Yield a configuration and whether it is closed, and some about it that are closed as well."""
    yield q, closed
    model, rng = scene.robot.model, np.random.default_rng(0)
    for _ in range(_TRIES):
        near = np.array(pin.integrate(model, q, _AWAY * rng.normal(size=model.nv)))
        if scene.rows and closed:
            assembly = scene.assemble(near, within_limits=False, throw=False)
            if not assembly.closed:
                continue
            near = assembly.q
        yield near, closed


def _least_share(robot: Robot, mass: MassFactor) -> float:
    """Return the least inertia that a joint feels while all that it carries moves freely."""
    # Over what it feels with all else locked. Joints whose own body has inertia enough feel as much
    # at any state, and are not looked at.
    watched = MassConditioning(robot.least_pivots, mass.pivots).watched
    shares = mass.pivots[watched] / mass.M.diagonal()[watched]
    return float(np.nan_to_num(shares).min(initial=1.0))


def _mass_factor(robot: Robot, q: Array, M: Array) -> MassFactor:
    """Return the factor of M; scenes of a robot share it where they are nominal at one q."""
    known = vars(robot)
    found: MassFactor | None = known.get("_mass_factor")
    if found is None or not np.array_equal(found.M, M):
        found = known["_mass_factor"] = factorise_mass(M, why=singular_mass(robot.model, q))
    return found


def _may_be_rounded(S: Array) -> bool:
    """Singular values in the metric of M among which digits of a file may have made one up."""
    shares = S / S.max(initial=1e-300)
    return bool(((shares > tolerances.REFERENCE_RANK) & (shares <= _CLEAR)).any())


def _idle_rows(equations: Equations, q: Array, P: Array) -> tuple[NDArray[np.bool_], bool]:
    """Rows (m,) that are no more than rounding where the loops are a little open."""
    # Of a planar loop one; of a loop in space none, even where one of them is redundant. And
    # whether any of them is not exactly zero.
    apart = _APART * np.random.default_rng(0).normal(size=equations.model.nv)
    q = pin.integrate(equations.model, q, apart)
    J = equations.parts(q, np.zeros(equations.model.nv))[2]
    sizes = np.linalg.norm(more_than(least_of(P), J), axis=1)
    idle = sizes <= ROUNDED * np.linalg.norm(P, axis=1)
    return idle, bool(sizes[idle].any())


# Nominal states: what a method is measured by, with the accelerations of `Reference`.


@dataclass(frozen=True, eq=False)
class NominalState:
    """A state on the constraints, and the accelerations there by `Reference`."""

    q: Array
    v: Array
    tau: Array
    a: Array
    # what errors of a are relative to: the larger of |a|_inf and gravity [rad/s^2, m/s^2]
    size: float
    torque: float  # the same for forces: the largest torque in the equation of a joint [N, N m]

    @classmethod
    def of(
        cls, q: Array, v: Array, tau: Array, a: Array, terms: Terms, gravity: float
    ) -> NominalState:
        """Return the state with its sizes."""
        size = max(float(np.abs(a).max()), gravity) or 1.0
        return cls(q, v, tau, a, size, largest_torque(terms, tau, size))


def nominal_states(
    equations: Equations, q: Array, factors: MinimumNorm, P: Array
) -> tuple[NominalState, ...]:
    """Return a state at rest, and one moving along the constraints under random torques."""
    rng = np.random.default_rng(0)
    nv, gravity = equations.model.nv, float(np.linalg.norm(equations.model.gravity.linear))
    # torques that alone would accelerate every joint by about 1 rad/s^2 or 1 m/s^2
    push = factors.L @ (factors.L.T @ rng.normal(size=nv))
    made = []
    for v, tau in ((np.zeros(nv), np.zeros(nv)), (factors.tangent(rng.normal(size=nv)), push)):
        terms = equations.terms(q, v)
        a, _ = Reference().solve(terms, tau, P)
        made.append(NominalState.of(q, v, tau, a, terms, gravity))
    return tuple(made)


# Postures: configurations that the description of a robot names.


def described_posture(scene: Scene, posture: str | None = None) -> Array:
    """Return a posture of the robot as it is in the description; neutral if it has none.

    Parameters
    ----------
    scene : Scene
    posture : str, optional
        Its name; the first one by default.

    Returns
    -------
    q : (nq,) array
        Configuration [rad, m].

    Raises
    ------
    InvalidArgument
        If the name is no text.
    UnknownName
        If there is no such posture.
    """
    postures = scene.robot.postures
    if posture is None:
        q = next(iter(postures.values()), None)
        return np.array(pin.neutral(scene.robot.model) if q is None else q)
    if not isinstance(posture, str):
        raise InvalidArgument(
            f"posture = {posture!r}: the name of a posture is needed; to start from values of "
            "joints, scene.assemble(robot.configuration({joint: value})).q"
        )
    if posture not in postures:
        raise unknown_name("posture", posture, postures)
    return np.array(postures[posture])
