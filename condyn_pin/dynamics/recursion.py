"""Recursive solvers: sweeps over the tree in place of a matrix, corrected by recomputed residuals.

Recursion: `pin.lcaba` with its state cured, bound to memory.

It carries the inertias of the constraints, 1/mu at the point of each, in the axes of the world.
Rounding of that is eps r^2 / mu, r being the distance to the origin of the world: what a light body
feels of it grows with the square of the way that a robot has walked. Where the robot is moves
nothing, so one that is further away than its longest chain is taken to the origin: the shifts of a
root joint that is free are set to 0.

What is left, eps / mu of the size of the robot, is made up for as in
`condyn_pin.dynamics.proof`: the residual r = M a + h - tau - J^T lam of Newton-Euler is taken
for a torque on the same robot, at rest and without weight, so that rounding is a share of the
correction,

    M da - J^T dlam = -r,     J da = 0.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final

import numpy as np

from condyn_pin._core import _pin
from condyn_pin._core.arguments import (
    ACCURACIES,
    ITERATIONS,
    WEIGHTS,
    Grid,
    check_accuracy,
    check_damping,
    check_iterations,
    check_proximal,
    check_refinements,
)
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg import factorise
from condyn_pin._core.tolerances import RANK
from condyn_pin.constraints.rows.bound import PinocchioConstraint
from condyn_pin.dynamics.mu import MakeSolver, WeightChoice, best_choice
from condyn_pin.dynamics.nominal import NominalAnalysis
from condyn_pin.dynamics.solvers.solver import BoundSolver, Solver
from condyn_pin.dynamics.workspace import Workspace


@dataclass(frozen=True)
class MatrixFreeSolver(Solver):
    """A solver by a Krylov method; each class documents its own parameters."""

    takes_redundant: ClassVar[bool] = True
    sweeps: ClassVar[tuple[Grid, ...]] = (
        {"mu": WEIGHTS},
        {"max_iterations": ITERATIONS},
        {"tolerance": ACCURACIES},
    )

    tolerance: float | None = None  # [m/s^2]
    max_iterations: int = 500
    mu: float = 0.0  # [1/kg]

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.tolerance is not None:
            check_accuracy("tolerance", self.tolerance)
        check_iterations(self.max_iterations)
        check_damping(self.mu)

    @abstractmethod
    def start(self, workspace: Workspace) -> BoundSolver:
        """Return this solver bound to `workspace`."""

    def wanted(self, workspace: Workspace) -> float:
        """Return the |a_ref - gamma - J a - mu lam|_inf that ends the iterations [m/s^2]."""
        if self.tolerance is not None:
            return self.tolerance
        return workspace.scene.nominal.estimator.tolerated_constraint_error / 10


def inverse_delassus(nominal: NominalAnalysis) -> Array:
    """Return the inverse of G at the nominal state, a multiple of I on what is redundant there."""
    factors = factorise(nominal.terms.M, nominal.terms.J, RANK)
    U, S = factors.U, factors.S
    eigenvalues = np.full(U.shape[1], nominal.delassus_norm)
    eigenvalues[: factors.rank] = S[: factors.rank] ** 2
    return np.asarray((U / eigenvalues) @ U.T)


Acceleration = Callable[[Array, Array, Array], Array]

# An acceleration, and the forces of the last one.
Recursing = tuple[Acceleration, Callable[[], Array]]

# Coordinates of root joints that are shifts along axes of the world.
_SHIFTS: Final = {"JointModelFreeFlyer": 3, "JointModelTranslation": 3, "JointModelPlanar": 2}

# The square of a distance to the origin beyond which nothing is a place [m^2].
_FAR: Final = 1e300


class LcabaRecursion:
    """`pin.lcaba` on one model, and on Pinocchio's lists of its constraints."""

    def __init__(
        self,
        model: Any,
        data: Any,
        pinocchio_constraints: Sequence[PinocchioConstraint],
        models: Any,
        datas: Any,
    ) -> None:
        self._solve = _pin.lcaba()
        self._bound = model, data, models, datas
        _pin.order_joints_for_lcaba(model, data, models)
        # only 6 rows read `oa` before it is written
        joints = sorted(
            {j for b in pinocchio_constraints if b.size == 6 for j in (b.joint1, b.joint2) if j}
        )
        self._clear = tuple(data.oa[joint].setZero for joint in joints)
        # views into the memory of the datas: to fetch an entry of the list costs a microsecond
        held = [datas[k].contact_force for k in range(len(pinocchio_constraints))]
        views = [f.vector[: b.size] for f, b in zip(held, pinocchio_constraints, strict=True)]
        self._held, self._views = held, views or [np.zeros(0)]
        roots = [i for i in range(1, model.njoints) if model.parents[i] == 0]
        kind = model.joints[1].shortname() if len(roots) == 1 else ""
        self._shifts, self._near = _SHIFTS.get(kind, 0), _longest_chain(model) ** 2

    def bind(self, settings: Any) -> Acceleration:
        """Return the accelerations with some settings."""
        solve, clear, shifts, near = self._solve, self._clear, self._shifts, self._near
        model, data, models, datas = self._bound
        origin = np.zeros(shifts)

        def acceleration(q: Array, v: Array, tau: Array) -> Array:
            for zero in clear:
                zero()
            if shifts:
                place = q[:shifts]
                if near < place.dot(place) < _FAR:  # what is not finite shows in the answer
                    q = np.concatenate((origin, q[shifts:]))
            return solve(model, data, q, v, tau, models, datas, settings)

        return acceleration

    def lam(self) -> Array:
        """Return the forces of Pinocchio's rows; its own have the other sign."""
        forces = np.asarray(np.concatenate(self._views))
        np.negative(forces, out=forces)
        return forces


def _longest_chain(model: Any) -> float:
    """Return the length of the longest chain of links from joint to joint [m]."""
    lengths = np.zeros(model.njoints)
    for i in range(1, model.njoints):
        parent = model.parents[i]
        if parent:  # where a root stands is no length of the robot
            step = np.linalg.norm(model.jointPlacements[i].translation)
            lengths[i] = lengths[parent] + step
    return float(lengths.max())


class CorrectedRecursion:
    """A recursion whose answers are corrected.

    answer, correct: the recursion, and the same without weight and without drift control: each an
        acceleration of (q, v, tau), and what returns the forces of Pinocchio's rows in the last one
    times: corrections
    """

    def __init__(
        self, workspace: Workspace, answer: Recursing, correct: Recursing, times: int
    ) -> None:
        self._workspace, self._times = workspace, times
        (self._run, self._lam), (self._correct, self._step) = answer, correct
        self._latest = np.zeros(workspace.scene.rows)
        self._at_rest = np.zeros(workspace.model.nv)

    @np.errstate(over="ignore", invalid="ignore")  # the status says it
    def acceleration(self, q: Array, v: Array, tau: Array) -> Array:
        """Return a (nv,) after the corrections."""
        workspace = self._workspace
        a = self._run(q, v, tau)
        lam = workspace.scene_forces(self._lam())
        for _ in range(self._times):
            r, _ = workspace.equations.residuals(q, v, tau, a, lam)
            a = a + self._correct(q, self._at_rest, -r)
            lam = lam + workspace.scene_forces(self._step())
        self._latest = lam
        return a

    def lam(self) -> Array:
        """Return the forces of the last answer, of the scene's rows."""
        return self._latest.copy()


# Solvers that carry constraints in the inertias of articulated bodies: their parameters.
#
# Their weight mu is measured on the scene (`condyn_pin.dynamics.mu`).


@dataclass(frozen=True)
class ArticulatedSolver(Solver):
    """A solver on articulated bodies; each class documents its own parameters."""

    takes_redundant: ClassVar[bool] = True
    takes_every_kind: ClassVar[bool] = False
    takes_world_first: ClassVar[bool] = False
    takes_open: ClassVar[bool] = False
    sweeps: ClassVar[tuple[Grid, ...]] = (
        {"mu": WEIGHTS, "max_iterations": (1, 20)},
        {"max_iterations": ITERATIONS},
        {"absolute_accuracy": ACCURACIES},
    )

    mu: float | None = None  # [1/kg]
    max_iterations: int = 200
    absolute_accuracy: float | None = None  # [m/s^2]
    refinements: int | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        check_proximal(self.mu, self.max_iterations, smallest_mu=1e-300)
        if self.absolute_accuracy is not None:
            check_accuracy("absolute_accuracy", self.absolute_accuracy)
        if self.refinements is not None:
            check_refinements(self.refinements)

    @abstractmethod
    def start(self, workspace: Workspace) -> BoundSolver:
        """Return this solver bound to `workspace`."""

    def started(self, workspace: Workspace, start: MakeSolver) -> BoundSolver:
        """Return the method with the weight of the scene, given or measured once."""
        nominal = workspace.scene.nominal
        if self.mu is not None:
            chosen = WeightChoice(self.mu, self.max_iterations, self.refinements or 0)
        elif (found := nominal.measured.get(self)) is not None:
            chosen = WeightChoice(*found)
        else:
            nominal.measured[self] = chosen = best_choice(self, workspace, start)
        bound, _ = start(chosen)
        return bound

    def wanted(self, workspace: Workspace) -> float:
        """Return the |J a + gamma - a_ref|_inf that ends the iterations [m/s^2]."""
        if self.absolute_accuracy is not None:
            return self.absolute_accuracy
        return workspace.scene.nominal.estimator.tolerated_constraint_error / 10
