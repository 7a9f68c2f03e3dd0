"""Reduced and vakonomic motion: two more equations for rows A(q) v = 0.

Machines move by forces that do no work (d'Alembert), M a + h = tau + A^T lam, which `solve` and
`simulate` have. K = dA(v, .) is the curvature of the rows (`condyn_pin.mechanism.curvature`).

**Reduced** (Chaplygin). Where neither energy nor rows depend on the coordinates of a fibre, the
base alone moves by itself. With G the columns of the fibre, w the velocity of the base, and
v = H w the velocity that it leads to, A H = 0,

    M_c w' + h_c = H^T tau - H^T K^T mu,    M_c = H^T M H,    mu = (A G)^-T G^T M v

h_c is that of an ordinary machine with the energy w^T M_c w / 2: what is left of the rows is the
torque of the connection, -H^T K^T mu. It does no work, and is zero where the rows are integrable.

**Vakonomic**. The motion that makes the action stationary among those that the rows allow, known
from optimal control, is that of no machine:

    M a + h = tau + A^T lam - K^T mu,    mu' = -lam

References
----------
Bloch. Nonholonomic Mechanics and Control. Springer, 2003, chapters 2 and 5.
Lewis, Murray. Variational principles for constrained systems: theory and experiment. International
Journal of Non-Linear Mechanics 30, 1995.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import normalised, seconds, step_size
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.linalg import rank_of
from condyn_pin._core.models import difference, whole_data
from condyn_pin._core.threads import one_blas_thread
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.dynamics.at_state import equations_of
from condyn_pin.dynamics.derivatives.kkt import Linearisation
from condyn_pin.dynamics.scene import Scene, check_bilateral, check_not_driven, check_scene
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import InvalidArgument, unknown_name
from condyn_pin.mechanism.classification import curvature_by
from condyn_pin.simulation.manifold import Manifold
from condyn_pin.simulation.system import System
from condyn_pin.simulation.torques import Torque
from condyn_pin.simulation.trajectory import Trajectory

# q and what changes with it, at t, to v and the rates of what changes
_Slope = Callable[[float, Array, Array], tuple[Array, Array]]

_PART: Final = ".translation"

# How many columns of a joint shift its body along axes that the body itself turns.
_SHIFTS: Final = {"JointModelFreeFlyer": 3, "JointModelPlanar": 2}


@dataclass(frozen=True, eq=False)
class _Motion:
    """Instants of a motion.

    Attributes
    ----------
    scene : Scene
    t : (k,) array
        Times [s].
    q, v : (k, nq), (k, nv) array
        Configurations and velocities.
    """

    scene: Scene
    t: Array  # [s]
    q: Array
    v: Array

    @property
    def energy(self) -> Array:
        """Kinetic and potential energy (k,) [J]."""
        model = self.scene.robot.unedited
        data = whole_data(model)
        return np.array(
            [
                pin.computeKineticEnergy(model, data, q, v)
                + pin.computePotentialEnergy(model, data, q)
                for q, v in zip(self.q, self.v, strict=True)
            ]
        )

    def distance(self, run: Trajectory) -> Array:
        """Return |q - q_run| (k,) to a `run` of the same scene at the same times [m, rad].

        Raises
        ------
        InvalidArgument
            If the times of the run are others.
        """
        if len(run.t) != len(self.t) or np.abs(run.t - self.t).max() > 1e-9 * self.t[-1]:
            raise InvalidArgument(
                f"run: it has {len(run.t)} instants up to {run.t[-1]:g} s, where {len(self.t)} up "
                f"to {self.t[-1]:g} s are needed: simulate with the same duration and dt"
            )
        model = self.scene.robot.unedited
        pairs = zip(self.q, run.q, strict=True)
        return np.array([np.linalg.norm(difference(model, one, two)) for one, two in pairs])


# Vakonomic motion.


@dataclass(frozen=True, eq=False)
class VakonomicMotion(_Motion):
    """Motion that makes the action stationary among those that the rows allow.

    Attributes
    ----------
    mu : (k, m) array
        Momenta of the rows [N s, N m s].
    """

    mu: Array


def vakonomic(
    scene: Scene,
    q: ArrayLike,
    v: ArrayLike,
    mu: ArrayLike = 0.0,
    *,
    duration: float,
    dt: float,
    tau: float | ArrayLike | Torque = 0.0,
) -> VakonomicMotion:
    """Compute the vakonomic motion of a scene, to compare with that of `simulate`.

    M a + h = tau + A^T lam - K^T mu,    A a + gamma = 0,    mu' = -lam

    Parameters
    ----------
    scene : Scene
        Rows that stay closed, on positions or on velocities.
    q, v : (nq,), (nv,) array_like
        Where it begins; v is allowed, A v = 0.
    mu : (m,) array_like
        Momenta of the rows at the beginning [N s, N m s]: the motion depends on them, and no
        principle has their values. Zero by default.
    duration, dt : float
        Length of the motion, and of a step by Runge and Kutta's method of order 4 [s].
    tau : (nv,) array_like or callable
        Torques, or a function of (t, q, v), as in `simulate` [N m, N].

    Returns
    -------
    VakonomicMotion

    Raises
    ------
    InvalidArgument
        If an argument has a wrong size or is not finite.
    NotAssembled
        If v violates the rows: a motion that begins so is none that they allow.
    UnsupportedConstraint
        If contacts may open, or constraints are driven.

    Notes
    -----
    If all rows are integrable both motions are the same. Cost: four times nv + 3 linearisations a
    step.

    References
    ----------
    Lewis, Murray. Variational principles for constrained systems: theory and experiment.
    International Journal of Non-Linear Mechanics 30, 1995.
    """
    q_, v_ = _accepted(scene, "vakonomic", q, v)
    mu_ = np.broadcast_to(np.asarray(mu, dtype=float), scene.rows)
    start = np.concatenate((v_, finite("mu", np.array(mu_), scene.rows)))
    system, nv, model = System(Workspace(scene), tau), scene.robot.nv, scene.robot.unedited
    of = Linearisation(model, scene.bounds)

    def slope(t: float, q: Array, x: Array) -> tuple[Array, Array]:
        v, mu = x[:nv], x[nv:]
        K = curvature_by(of, model, q, v, len(mu))
        a = system.solve(q, v, system.torque(t, q, v) - K.T @ mu)
        return v, np.concatenate((a, -system.lam()))

    t, found_q, found_v, x = _motion(scene, slope, q_, start, duration, dt)
    return VakonomicMotion(scene, t, found_q, found_v, x[:, nv:])


# Chaplygin's reduction.


class ReducedTerms(NamedTuple):
    """Terms of the reduced equation M w' + h = H^T tau + connection at one state.

    Attributes
    ----------
    M : (d, d) array
        Mass matrix of the base, H^T M H.
    h : (d,) array
        Coriolis, centrifugal and gravity torques of a machine with that mass matrix [N m, N].
    connection : (d,) array
        Torque of the connection, -H^T K^T mu [N m, N].
    H : (nv, d) array
        Velocities of all joints that those of the base lead to, v = H w [1, m, 1/m].
    """

    M: Array
    h: Array
    connection: Array
    H: Array


@dataclass(frozen=True, eq=False)
class ReducedMotion(_Motion):
    """Motion by the reduced equation, the fibre by quadrature.

    Attributes
    ----------
    w : (k, d) array
        Velocities of the base [rad/s, m/s].
    """

    w: Array


@dataclass(frozen=True)
class ChaplyginReduction:
    """Equations of the base of a scene, with the rows solved for the velocities of a fibre.

    M_c w' + h_c = H^T tau - H^T K^T mu,    v = H w,    mu = (A G)^-T G^T M v

    Parameters
    ----------
    scene : Scene
        A machine with rows on the velocity.
    fibre : sequence of str
        Joints whose position matters to neither energy nor rows, with as many velocities as there
        are independent rows; of a free-flyer or a plane ``joint.translation`` has its shifts alone.

    Raises
    ------
    InvalidArgument
        If the fibre has more or fewer velocities than there are independent rows, or energy or rows
        depend on where it is.
    UnknownName
        If there is no such joint.
    UnsupportedConstraint
        If contacts may open, or constraints are driven.

    References
    ----------
    Neimark, Fufaev. Dynamics of Nonholonomic Systems. American Mathematical Society, 1972.
    Bloch. Nonholonomic Mechanics and Control. Springer, 2003, chapter 5.
    """

    scene: Scene
    fibre: tuple[str, ...]

    def __init__(self, scene: Scene, fibre: Sequence[str]) -> None:
        check_scene(scene)
        check_bilateral(scene)
        check_not_driven(scene, "ChaplyginReduction")
        if isinstance(fibre, str):
            raise InvalidArgument(f"fibre = {fibre!r}: a list of joints is needed")
        object.__setattr__(self, "scene", scene)
        object.__setattr__(self, "fibre", tuple(fibre))
        self._check()

    @cached_property
    def columns(self) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
        """Columns of v that are of the base, and those of the fibre."""
        model, chosen = self.scene.robot.model, list[int]()
        for name in self.fibre:
            joint = self._joint(name)
            size = _SHIFTS[joint.shortname()] if name.endswith(_PART) else int(joint.nv)
            chosen += range(joint.idx_v, joint.idx_v + size)
        fibre = np.array(chosen, dtype=np.int_)
        return np.setdiff1d(np.arange(model.nv), fibre), fibre

    def terms(self, q: ArrayLike, w: ArrayLike) -> ReducedTerms:
        """Return the terms at q (nq,) and the velocity w (d,) of the base."""
        return self._terms(*self._accepted(q, w), self._linearisation())

    def _terms(self, q: Array, w: Array, of: Linearisation) -> ReducedTerms:
        """Terms in the memory of a linearisation, without checks."""
        H = self._lift(q)
        v = H @ w
        terms = equations_of(self.scene).terms(q, v)
        _, fibre = self.columns
        bend = np.zeros(len(v))  # H' w: A H' w = -gamma
        bend[fibre] = np.linalg.lstsq(terms.J[:, fibre], -terms.gamma)[0]
        K = curvature_by(of, self.scene.robot.unedited, q, v, self.scene.rows)
        mu = np.linalg.lstsq(terms.J[:, fibre].T, (terms.M @ v)[fibre])[0]
        connection = -H.T @ (K.T @ mu)
        by_rows = H.T @ (terms.h + terms.M @ bend)  # of M_c w' + by_rows = H^T tau
        return ReducedTerms(H.T @ terms.M @ H, by_rows + connection, connection, H)

    def velocity(self, q: ArrayLike, w: ArrayLike) -> Array:
        """Return v (nv,) = H w at q (nq,) and the velocity w (d,) of the base."""
        q_, w_ = self._accepted(q, w)
        return self._lift(q_) @ w_

    def base(self, v: ArrayLike) -> Array:
        """Return the velocity w (d,) of the base in v (nv,)."""
        return finite("v", v, self.scene.robot.nv)[self.columns[0]]

    def simulate(
        self,
        q: ArrayLike,
        w: ArrayLike,
        *,
        duration: float,
        dt: float,
        tau: float | ArrayLike | Torque = 0.0,
    ) -> ReducedMotion:
        """Compute the motion by the reduced equation; the fibre follows by v = H w.

        Parameters
        ----------
        q, w : (nq,), (d,) array_like
            Where it begins, and the velocity of the base.
        duration, dt : float
            Length of the motion, and of a step by Runge and Kutta's method of order 4 [s].
        tau : (nv,) array_like or callable
            Torques, or a function of (t, q, v), as in `condyn_pin.simulate` [N m, N].

        Raises
        ------
        InvalidArgument
            If an argument has a wrong size or is not finite.
        """
        q_, w_ = self._accepted(q, w)
        system, of = System(Workspace(self.scene), tau), self._linearisation()

        def slope(t: float, q: Array, w: Array) -> tuple[Array, Array]:
            M, h, connection, H = self._terms(q, w, of)
            v = H @ w
            left = H.T @ system.torque(t, q, v) + connection - h
            return v, np.asarray(np.linalg.solve(M, left))

        t, found_q, v, found_w = _motion(self.scene, slope, q_, w_, duration, dt)
        return ReducedMotion(self.scene, t, found_q, v, found_w)

    def _linearisation(self) -> Linearisation:
        return Linearisation(self.scene.robot.unedited, self.scene.bounds)

    def __reduce__(self) -> tuple[Any, ...]:
        return ChaplyginReduction, (self.scene, self.fibre)

    def _accepted(self, q: ArrayLike, w: ArrayLike) -> tuple[Array, Array]:
        q_ = normalised(self.scene.robot.model, "q", q)
        return q_, finite("w", w, len(self.columns[0]))

    def _joint(self, name: str) -> Any:
        model, joint = self.scene.robot.model, name.removesuffix(_PART)
        if joint not in self.scene.robot.joints:
            raise unknown_name("joint", joint, self.scene.robot.joints)
        found = model.joints[model.getJointId(joint)]
        if name != joint and found.shortname() not in _SHIFTS:
            raise InvalidArgument(
                f"fibre: {joint} is a {found.shortname()}; .translation is of free-flyers and "
                "planes, and other joints are named as a whole"
            )
        return found

    def _lift(self, q: Array) -> Array:
        """Return H (nv, d): 1 on the base, and what the rows make of it on the fibre."""
        A, (base, fibre) = equations_of(self.scene).jacobian(q), self.columns
        H = np.zeros((len(base) + len(fibre), len(base)))
        H[base, np.arange(len(base))] = 1.0
        H[fibre] = np.linalg.lstsq(A[:, fibre], -A[:, base])[0]
        return H

    def _check(self) -> None:
        """Refuse a fibre that the rows do not decide, or that energy or rows feel."""
        rng, equations = np.random.default_rng(0), equations_of(self.scene)
        fibre, rank = self.columns[1], self.scene.nominal.rank
        q, v = self.scene.sample(rng)
        A = equations.jacobian(q)[:, fibre]
        decided = rank_of(np.linalg.svd(A, compute_uv=False)) if A.size else 0
        if not len(fibre) == rank == decided:
            raise InvalidArgument(
                f"fibre = {list(self.fibre)}: {len(fibre)} velocities, of which the rows decide "
                f"{decided}, and {rank} independent rows; as many velocities are needed, and all "
                "decided by them"
            )
        here, there = (_invariants(equations, at, v) for at in (q, self._elsewhere(q, rng)))
        for what, one, two in zip(("energy", "rows"), here, there, strict=True):
            if np.abs(one - two).max() > tolerances.CONSISTENT * max(1.0, np.abs(one).max()):
                raise InvalidArgument(
                    f"fibre = {list(self.fibre)}: the {what} of {self.scene.robot.name} depends on "
                    "where it is, and Chaplygin's reduction has no such fibre"
                )

    def _elsewhere(self, q: Array, rng: np.random.Generator) -> Array:
        """Return q with the fibre elsewhere; bodies keep their velocities in their own axes."""
        found, neutral = q.copy(), pin.neutral(self.scene.robot.model)
        anywhere = pin.integrate(
            self.scene.robot.model,
            neutral,
            rng.normal(size=len(self.columns[0]) + len(self.columns[1])),
        )
        for name in self.fibre:
            joint = self._joint(name)
            size = _SHIFTS[joint.shortname()] if name.endswith(_PART) else int(joint.nq)
            at = slice(joint.idx_q, joint.idx_q + size)
            found[at] = anywhere[at]
        return found


def _invariants(equations: Equations, q: Array, v: Array) -> tuple[Array, Array]:
    """M with h, and the projector on what rows leave: both of v (nv,)."""
    terms = equations.terms(q, v)
    energy: Array = np.append(terms.M.ravel(), terms.h)
    projector: Array = np.asarray(np.linalg.pinv(terms.J, rcond=tolerances.RANK) @ terms.J)
    return energy, projector


# Both: how motions begin, and their steps.


def _accepted(scene: Scene, what: str, q: ArrayLike, v: ArrayLike) -> tuple[Array, Array]:
    """Return q and v of a user, which the rows allow."""
    check_scene(scene)
    check_bilateral(scene)
    check_not_driven(scene, what)
    q_, v_ = normalised(scene.robot.model, "q", q), finite("v", v, scene.robot.nv)
    scene.check(q_, v_).raise_if_open()
    return q_, v_


@one_blas_thread
def _motion(
    scene: Scene, slope: _Slope, q: Array, x: Array, duration: float, dt: float
) -> tuple[Array, Array, Array, Array]:
    """Return t, q, v and x of a motion q' = v, x' = f by Runge and Kutta's method of order 4."""
    seconds("duration", duration)
    count = max(1, round(duration / step_size(dt)))
    h, manifold = duration / count, Manifold(scene.robot.unedited)
    t, found_q, found_v, found_x = np.linspace(0.0, duration, count + 1), [q], list[Array](), [x]

    def stage(t: float, y: Array, x: Array) -> tuple[Array, Array, Array]:
        at = manifold.integrate(q, y)
        v, rate = slope(t, at, x)
        return manifold.rate(y, manifold.of_start(y, v)), rate, v

    for now in t[:-1].tolist():
        still = np.zeros(scene.robot.nv)
        y1, x1, v = stage(now, still, x)
        y2, x2, _ = stage(now + h / 2, h / 2 * y1, x + h / 2 * x1)
        y3, x3, _ = stage(now + h / 2, h / 2 * y2, x + h / 2 * x2)
        y4, x4, _ = stage(now + h, h * y3, x + h * x3)
        q = manifold.integrate(q, h / 6 * (y1 + 2 * (y2 + y3) + y4))
        x = x + h / 6 * (x1 + 2 * (x2 + x3) + x4)
        found_q.append(q)
        found_x.append(x)
        found_v.append(v)
    found_v.append(slope(duration, q, x)[0])
    return t, np.array(found_q), np.array(found_v), np.array(found_x)
