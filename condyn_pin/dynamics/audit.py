"""What a scene is, measured once at its nominal state: rank, redundant rows, mobility, scales."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.blas_threads import one_blas_thread
from condyn_pin._core.errors import BranchChanged, InvalidModel, NotAssembled
from condyn_pin._core.linalg.minimum_norm import MinimumNorm, factorise
from condyn_pin._core.linalg.pivots import redundant_rows
from condyn_pin._core.linalg.range_space import whiten
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.constraints.rows.mass_pivots import MassPivots
from condyn_pin.constraints.rows.natives import Natives
from condyn_pin.constraints.rows.reach import ROUNDED, reach
from condyn_pin.constraints.rows.terms import Terms, largest_torque
from condyn_pin.dynamics.proof import Yardstick
from condyn_pin.dynamics.solvers.reference import Reference
from condyn_pin.model.soundness import massless_motion, singular_mass

if TYPE_CHECKING:
    from condyn_pin.dynamics.scene import Scene
    from condyn_pin.dynamics.solvers.base import Solver

# How far joints are moved to open loops [rad, m].
_APART = 1e-3


@dataclass(frozen=True, eq=False)
class NominalState:
    """A state on the constraints, and the accelerations there by `Reference`.

    Attributes
    ----------
    q, v, tau, a : array
    size : float
        What errors of a are relative to: the larger of |a|_inf and gravity [rad/s^2, m/s^2].
    torque : float
        The same for forces: the largest torque in the equation of a joint [N, N m].
    """

    q: Array
    v: Array
    tau: Array
    a: Array
    size: float
    torque: float

    @classmethod
    def of(
        cls, q: Array, v: Array, tau: Array, a: Array, terms: Terms, gravity: float
    ) -> NominalState:
        """Return the state with its sizes."""
        size = max(float(np.abs(a).max()), gravity) or 1.0
        return cls(q, v, tau, a, size, largest_torque(terms, tau, size))


@dataclass(frozen=True, eq=False)
class Audit:
    """Figures of a scene at its nominal state.

    Attributes
    ----------
    q : (nq,) array
        The nominal state: the first posture, or neutral, with the loops closed.
    closed : bool
        Whether the loops could be closed; if not, all figures are those of the open state.
    singular_values : (min(m, nv),) array
        Of J L^-T, the constraint Jacobian in the metric of M [kg^-1/2].
    rank, mobility : int
        Independent rows, and nv minus that: the degrees of freedom that are left.
    redundant : tuple of str
        Rows that can go without changing the motion, as ``constraint.axis``.
    independent : bool
        Whether all rows count but those that are zero, and stay so where loops are open. Those that
        Pinocchio takes as two points do not: a row too many.
    rounded : bool
        Whether rows that are zero are so but for rounding, as across a loop in a slanted plane.
    condition : float
        Condition number of the mass matrix.
    delassus_norm : float
        Largest eigenvalue of J M^-1 J^T [1/kg]; 1/mass without constraints.
    native_spectrum : (float, float)
        Largest and smallest nonzero eigenvalue of the same with the rows that Pinocchio has in
        place of the scene's (`condyn_pin.constraints.rows.natives`) [1/kg].
    weight : float
        Mass times gravity, or mass times 1 m/s^2 without gravity [N].
    yardstick : Yardstick
        What turns residuals into an error of a.
    pivots : MassPivots
        Those of M that may be far less elsewhere.
    states : tuple of NominalState
        At q: at rest, and moving along the constraints with random torques.
    terms : Terms
        M, h, J and gamma at q, at rest.
    measured : dict of Solver to tuple
        What a solver has measured on the scene, so that its next workspace need not.
    """

    q: Array
    closed: bool
    singular_values: Array
    rank: int
    mobility: int
    redundant: tuple[str, ...]
    independent: bool
    rounded: bool
    condition: float
    delassus_norm: float
    native_spectrum: tuple[float, float]
    weight: float
    yardstick: Yardstick
    pivots: MassPivots
    states: tuple[NominalState, ...]
    terms: Terms
    measured: dict[Solver, tuple[float, int, int]] = field(default_factory=dict)

    @property
    def delassus_condition(self) -> float:
        """Condition number of G = J M^-1 J^T as Pinocchio has it, but for redundant rows."""
        largest, smallest = self.native_spectrum
        return largest / smallest


@one_blas_thread
def audit(scene: Scene) -> Audit:
    """Measure a scene."""
    robot = scene.robot
    q, closed = _nominal_configuration(scene)
    equations = Equations(robot.model, scene.bounds)
    terms = equations.terms(q, np.zeros(robot.nv))
    P = reach(equations, q)
    factors = factorise(
        terms.M, terms.J, tolerances.RANK, why=singular_mass(robot.model, q)
    ).above_rounding(P)
    S, rank = factors.S, factors.rank
    gravity = float(np.linalg.norm(robot.model.gravity.linear))
    weight = robot.mass * (gravity or 1.0)
    lively, rounded = _lively_rows(equations, q)
    norm = float(S[0] ** 2) if rank else 1 / robot.mass
    return Audit(
        q=q,
        closed=closed,
        singular_values=S,
        rank=rank,
        mobility=robot.nv - rank,
        redundant=redundant_rows(factors.U[:, rank:], scene.row_names),
        independent=rank == lively and not scene.natives.imitated,
        rounded=rounded,
        condition=float(np.linalg.cond(terms.M)),
        delassus_norm=norm,
        native_spectrum=_native_spectrum(scene.natives, factors) if rank else (norm, norm),
        weight=weight,
        yardstick=Yardstick.of(factors, P, gravity, weight),
        pivots=MassPivots(robot.model, terms.M),
        states=_nominal_states(equations, q, factors, P),
        terms=terms,
    )


@one_blas_thread
def whitened_rows(scene: Scene) -> Array:
    """Return J L^-T (m, nv) at the nominal state, the Jacobian in the metric of M."""
    robot, (q, _) = scene.robot, _nominal_configuration(scene)
    terms = Equations(robot.model, scene.bounds).terms(q, np.zeros(robot.nv))
    whitened = whiten(terms.M, terms.J)
    if whitened is None:
        said = massless_motion(robot.model, q)
        raise InvalidModel(said or "the mass matrix is not positive definite at the nominal state")
    if not np.isfinite(whitened[1]).all():
        raise InvalidModel("the constraint Jacobian is not finite at the nominal state")
    return np.asarray(whitened[1].T)


def _nominal_configuration(scene: Scene) -> tuple[Array, bool]:
    """Return q of the nominal state, and whether the loops are closed there."""
    try:
        return scene.state()[0], True
    except BranchChanged as error:
        return error.assembly.q, True
    except NotAssembled:
        return scene.guess(), False


def _native_spectrum(native: Natives, factors: MinimumNorm) -> tuple[float, float]:
    """Return the largest and the smallest nonzero eigenvalue of G as Pinocchio has it.

    With lam = E^T lam_native and J L^-T = U S V^T these are the squares of the singular values of
    E U S. Rows that Pinocchio does not have stay as they are.
    """
    rank, E_ = factors.rank, native.to_scene
    S = factors.S[:rank]
    if E_ is not None and not native.missing:
        S = np.asarray(np.linalg.svd(E_.T @ (factors.U[:, :rank] * S), compute_uv=False), float)
    return float(S[0] ** 2), float(S[rank - 1] ** 2)


def _lively_rows(equations: Equations, q: Array) -> tuple[int, bool]:
    """Return how many rows are more than rounding where the loops are a little open.

    Of a planar loop two; of a loop in space all three, even where one of them is redundant. And
    whether any of the others is not exactly zero.
    """
    apart = _APART * np.random.default_rng(0).normal(size=equations.model.nv)
    q = pin.integrate(equations.model, q, apart)
    sizes = np.linalg.norm(equations.jacobian(q), axis=1)
    lively = sizes > ROUNDED * np.linalg.norm(reach(equations, q), axis=1)
    return int(np.count_nonzero(lively)), bool(sizes[~lively].any())


def _nominal_states(
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
