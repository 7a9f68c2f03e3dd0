"""A workspace's scene in the compiled core: arrays across the border, answers back.

CompiledCore: a workspace whose hot loops are compiled.

What the core answers is what Python would: the same Pinocchio, the same numbers, and the proof by
the same equations. Where the proof of a state leaves a doubt, or the iteration ends at nothing,
the state is answered by Python: hard cases are handled in one place only.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from functools import cached_property
from math import inf
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import QUATERNION_TOLERANCE, State, listed
from condyn_pin._core.arrays import Array
from condyn_pin._core.compiled import compiled, constrained_aba, refuse
from condyn_pin._core.models import axes, indices, is_forest
from condyn_pin.constraints.contacts.candidates import pieces_of
from condyn_pin.constraints.contacts.shapes import Core
from condyn_pin.constraints.drift import Baumgarte
from condyn_pin.constraints.forces import AppliedForce, Loads
from condyn_pin.constraints.rows.bound import BoundConstraint, PinocchioConstraint, placement
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.constraints.rows.redundancy import Redundancy
from condyn_pin.dynamics.derivatives.kkt import KktDerivatives, Linearisation
from condyn_pin.dynamics.derivatives.others import BLOCKS
from condyn_pin.dynamics.derivatives.solution_derivatives import Derivatives
from condyn_pin.dynamics.residuals import ErrorEstimator, Residuals
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solution import Question, Solution, Status
from condyn_pin.dynamics.solvers.dense_kkt import DenseKKT
from condyn_pin.dynamics.solvers.null_space import NullSpace
from condyn_pin.dynamics.solvers.proximal import Proximal
from condyn_pin.dynamics.solvers.solver import Singular, Solver
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import UnsupportedBackend
from condyn_pin.model.robot import Robot

# A scene as plain arrays, and what of it the compiled core does not take.
#
# No object of Pinocchio crosses the border: kinds of joints by their names, everything else as
# numbers. ``native/src/core`` reads them; the places of its fields are those here.


# No acceleration of a machine, as in `Workspace`.
_LARGEST: Final = 1e100

# Kinds of joints that are compiled.
JOINTS: Final = (
    *("JointModelRX", "JointModelRY", "JointModelRZ", "JointModelRevoluteUnaligned"),
    *("JointModelPX", "JointModelPY", "JointModelPZ", "JointModelPrismaticUnaligned"),
    *("JointModelFreeFlyer", "JointModelSpherical"),
)


# Solvers in the order of their methods there, after `Proximal`. These are exact, and so is what the
# core has in their place: nothing but rounding tells them from it.
_DIRECT: Final[tuple[Solver, ...]] = (DenseKKT(), NullSpace())


def why_not(workspace: Workspace) -> Iterator[str]:
    """Yield the features of a workspace that the core lacks, in words."""
    if "compiled" in vars(workspace):  # it was asked before
        return
    solver = workspace.solver
    if type(solver) is not Proximal:
        if solver not in _DIRECT:
            yield f"solver = {solver!r}: it has Proximal, DenseKKT() and NullSpace()"
    elif solver.iteration(workspace.scene.nominal).refinements:
        yield f"solver = {solver!r}: it makes no refinements, which this scene needs"
    if workspace.scene.nominal.rounded_file:
        yield "rows that digits of the file make count (Robot.precision)"
    yield from why_not_rows(workspace.model, workspace.bounds)


def why_not_method(method: str | None) -> Iterator[str]:
    """Yield the reason that the core lacks a method of derivatives, in words."""
    if method not in (None, "kkt"):
        yield f"method = {method!r}: its derivatives are those of 'kkt'"


def why_not_rows(model: Any, bounds: Sequence[BoundConstraint]) -> Iterator[str]:
    """Yield the joints and constraints of a model that the core lacks, in words."""
    if is_forest(model):
        yield f"{model.nv} degrees of freedom of many trees: it keeps no memory for each of them"
    yield from _why_not_joints(model)
    for bound in bounds:
        if bound.compiled() is None:
            yield f"constraint {bound.name!r}: it has no such rows"
        if bound.drift:
            yield f"constraint {bound.name!r}: it has drift control of its own, {bound.drift!r}"


def _why_not_joints(model: Any) -> Iterator[str]:
    for name, joint in zip(model.names, model.joints, strict=True):
        if joint.id and joint.shortname() not in JOINTS:
            yield f"joint {name!r} is a {joint.shortname()}, which it was not compiled for"


def of_model(model: Any) -> dict[str, Any]:
    """Return all numbers of a model that the equations read."""
    kinds, rows, q = [], [], pin.neutral(model)
    for i in range(1, model.njoints):
        joint, Y = model.joints[i], model.inertias[i]
        axis = np.zeros(3)
        if joint.nv == 1:
            linear, angular = axes(joint, q)[:, 0].reshape(2, 3)
            axis = angular if angular.any() else linear
        kinds.append(joint.shortname())
        placed = placement(model.jointPlacements[i])
        rows.append([*axis, *placed, Y.mass, *Y.lever, *Y.inertia.ravel()])
    return {
        "kinds": kinds,
        "parents": np.array(list(model.parents)[1:], np.int32),
        "joints": np.array(rows, float).reshape(-1, 28),
        "gravity": np.array(model.gravity.linear),
        "armature": np.array(model.armature),
        "damping": np.array(model.damping, float),
    }


def of_springs(robot: Robot) -> dict[str, Any]:
    """Return the springs: of joints stiffness and reference, and where q and v hold each."""
    # Between frames the joints that these are on, their origins there, and what acts along the
    # line.
    chosen = [spring for spring in robot.springs if spring.stiffness]
    at_q, at_v = indices(robot.model, [spring.joint for spring in chosen])
    numbers = [[spring.stiffness, spring.reference] for spring in chosen]
    acting = [each for each in robot.spring_dampers if each.stiffness or each.damping]
    ends = [(robot.frame(each.frame_a), robot.frame(each.frame_b)) for each in acting]
    joints = [[joint for joint, _ in pair] for pair in ends]
    lines = [
        [*a.translation, *b.translation, each.stiffness, each.damping, each.rest_length]
        for ((_, a), (_, b)), each in zip(ends, acting, strict=True)
    ]
    return {
        "springs": np.array(numbers, float).reshape(-1, 2),
        "of_springs": np.column_stack([at_q, at_v]).astype(np.int32),
        "between": np.array(joints, np.int32).reshape(-1, 2),
        "of_between": np.array(lines, float).reshape(-1, 9),
    }


def of_rows(bounds: Sequence[BoundConstraint], drift: Baumgarte | None) -> dict[str, Any]:
    """Return the rows of a scene, and the gains that draw them back."""
    rows = [made for bound in bounds if (made := bound.compiled())]
    return {
        "constraints": np.array([row.integers for row in rows], np.int32).reshape(-1, 14),
        "of_constraints": np.array([row.numbers for row in rows], float).reshape(-1, 27),
        "drift": np.array([drift.Kp, drift.Kd] if drift else [0.0, 0.0]),
    }


def of_constraints(workspace: Workspace) -> dict[str, Any]:
    """Return the rows of the scene, what Pinocchio has in their place, and where paths are."""
    found, equations = workspace.pinocchio_constraints, workspace.equations
    taken = found.constraints if type(workspace.solver) is Proximal else ()
    plain = [
        ([c.size, c.joint1, c.joint2, c.anchored, c.approximates],
         [*placement(c.placement1), *placement(c.placement2)])
        for c in taken
    ]  # fmt: skip
    to_scene = found.to_scene if taken and found.to_scene is not None else np.zeros((0, 0))
    return of_rows(workspace.bounds, workspace.drift) | {
        "plain": np.array([ints for ints, _ in plain], np.int32).reshape(-1, 5),
        "of_plain": np.array([numbers for _, numbers in plain], float).reshape(-1, 24),
        "to_scene": np.ascontiguousarray(to_scene),
        "wanted": equations.wanted_at(None) if equations.is_driven else np.zeros((3, 0)),
    }


def of_solver(workspace: Workspace) -> dict[str, Any]:
    """Return the method, the iteration of `Proximal`, and the constants of the error check."""
    solver, nominal = workspace.solver, workspace.scene.nominal
    plan = [0.0] * 14
    if isinstance(solver, Proximal):
        mu, accuracy, limit, patient, _ = solver.iteration(nominal)
        better = solver.mu_at_state(workspace).numbers if patient else (0.0,) * 9
        plan = [solver.absolute_accuracy, accuracy, mu, limit, patient, *better]
    return {
        "method": 1 + _DIRECT.index(solver) if solver in _DIRECT else 0,
        "weights": np.ascontiguousarray(nominal.estimator.weights),
        "verdict": of_verdict(nominal.estimator),
        "open_squared": tolerances.OPEN**2,
        "watched": nominal.pivots.watched.astype(np.int32),
        "nominal_pivots": np.ascontiguousarray(nominal.pivots.nominal),
        "rank": np.array([nominal.dependent, workspace.equations.least], float),
        "proximal": np.array(plan, float),
    }


def of_precision(scene: Scene) -> dict[str, Any]:
    """Scales of rows and moves, and where rows are judged at the precision of a state."""
    nominal, is_judged = scene.nominal, scene.rows and scene.robot.precision > 0.0
    every_row = Redundancy(np.ones(scene.rows), np.ones(scene.robot.nv), 0, 0.0, 1.0)
    by, gap = (nominal.redundancy, tolerances.OPEN) if is_judged else (every_row, inf)
    off = gap, gap if nominal.dependent else inf, tolerances.AJAR if is_judged else inf
    numbers = [by.floor, by.least, tolerances.REFERENCE_RANK, *off, tolerances.DOUBT, by.size]
    return {
        "row_scales": np.ascontiguousarray(by.R),
        "move_scales": np.ascontiguousarray(by.D),
        "precision": np.array([*numbers, nominal.looks_independent], float),
        "idle": np.flatnonzero(nominal.idle).astype(np.int32),
    }


def of_verdict(by: ErrorEstimator) -> Array:
    """Return the constants of the error check, as in `ErrorEstimator.prove` and `Verifier`."""
    of_residuals = by.gravity, by.largest_weight, by.per_row, by.rounding, *by.leaning_rounding
    of_doubts = (
        by.negligible_constraint_error,
        by.plausible_acceleration,
        by.plausible_force,
        by.negligible_dynamics_error,
    )
    return np.array([*of_residuals, *of_doubts, tolerances.SOLVED, QUATERNION_TOLERANCE, _LARGEST])


def of_forces(loads: Loads, forces: Sequence[AppliedForce], count: int) -> dict[str, Any]:
    """Return forces from outside at some states: where they act, and their six numbers at each."""
    bound = loads.bind([force.row(0) for force in forces]) if count else ()
    wrenches = np.zeros((count, 6 * len(bound)))
    for k, force in enumerate(forces[: len(bound)]):
        wrenches[:, 6 * k : 6 * k + force.numbers.shape[-1]] = force.numbers
    placements = [placement(push.place.placement) for push in bound]
    pushes = [(push.place.joint, push.in_world) for push in bound]
    return {
        "pushes": np.array(pushes, np.int32).reshape(-1, 2),
        "placements": np.array(placements, float).reshape(-1, 12),
        "wrenches": wrenches,
    }


def contiguous(x: Array, count: int) -> Array:
    """Return an array with one row per state: what has one axis is the same for all."""
    return np.ascontiguousarray(np.broadcast_to(x, (count, x.shape[-1])))


# CompiledCore: a workspace whose hot loops are compiled.


_OK: Final = Status.OK

Outputs = dict[str, NDArray[Any]]


class CompiledCore:
    """The core of one workspace, with memory for its threads."""

    def __init__(self, workspace: Workspace) -> None:
        refuse(why_not(workspace))
        self.workspace, self._arguments = workspace, workspace.scene.robot.arguments
        self._scene = workspace.scene
        nq, n, m = workspace.model.nq, workspace.model.nv, self._scene.rows
        # of what comes back of one state: a, lam, q, v, and seven numbers
        self._ends, self._size = (n, n + m, n + m + nq, n + m + nq + n), n + m + nq + n + 7
        self._blocks = 3, n + m, n
        self.core = compiled().Core(
            **of_model(workspace.model),
            **of_springs(workspace.scene.robot),
            **of_constraints(workspace),
            **of_solver(workspace),
            **of_precision(workspace.scene),
        )
        self._solve, self._differentiate = self.core.solve_one, self.core.differentiate_one

    def check(self, forces: Sequence[AppliedForce] = (), method: str = "kkt") -> None:
        """Refuse forces and methods that the core lacks at a single state."""
        if forces:
            refuse([f"forces = {forces!r}: it has forces from outside for batches alone"])
        refuse(why_not_method(method))

    def solve(
        self, state: State, outputs: Outputs, *, accuracy: float | None, threads: int,
        forces: Sequence[AppliedForce] = (),
    ) -> NDArray[np.intp]:  # fmt: skip
        """Fill the outputs of a `BatchSolution`; return the rows that are left to Python."""
        # The others are ok. `state` is q (k, nq), v (k, nv) and tau, (k, nv) or (nv,); `forces` are
        # the same for all, or have one row per state.
        more = {"threads": threads}
        return self._answer(self.core.solve, state, outputs, accuracy, forces, more)

    def differentiate(
        self, state: State, outputs: Outputs, *, accuracy: float | None, threads: int,
        forces: Sequence[AppliedForce] = (),
    ) -> NDArray[np.intp]:  # fmt: skip
        """Fill the outputs of a `BatchDerivatives`; return the rows that are left to Python."""
        more = {"threads": threads, "blocks": [outputs[name] for name in BLOCKS]}
        return self._answer(self.core.differentiate, state, outputs, accuracy, forces, more)

    def one(self, q: ArrayLike, v: ArrayLike, tau: ArrayLike, accuracy: float) -> Solution | None:
        """Return the solution of one state; None where Python has to answer."""
        # Arrays that are right already are checked in the core alone.
        out = np.empty(self._size)
        try:
            said = self._solve(q, v, tau, accuracy, out)
        except (TypeError, ValueError):
            said = self._solve(*self._converted(q, v, tau), accuracy, out)
        return said and self._solution(out, tau, *said)

    def derivatives(
        self, q: ArrayLike, v: ArrayLike, tau: ArrayLike, accuracy: float
    ) -> CompiledDerivatives | None:
        """Return the derivatives at one state; None where Python has to answer."""
        out, blocks = np.empty(self._size), np.empty(self._blocks)
        try:
            clear = self._differentiate(q, v, tau, accuracy, out, blocks)
        except (TypeError, ValueError):
            clear = self._differentiate(*self._converted(q, v, tau), accuracy, out, blocks)
        return CompiledDerivatives(self, out, blocks, _private_copy(tau)) if clear else None

    def solution(self, out: Array, tau: Array) -> Solution:
        """Return the solution of one state that the core has written beside its derivatives."""
        *residuals, iterations, seconds = out[self._ends[-1] :].tolist()
        return self._solution(out, tau, residuals, int(iterations), seconds)

    def _solution(
        self, out: Array, tau: ArrayLike, residuals: Iterable[float], iterations: int,
        seconds: float,
    ) -> Solution:  # fmt: skip
        a, lam, q, v = self._ends
        question = Question(out[lam:q], out[q:v], _private_copy(tau), (), self.workspace.drift)
        return Solution(
            a=out[:a], lam=out[a:lam], residuals=Residuals._make(residuals), status=_OK,
            iterations=iterations, solve_time=seconds, scene=self._scene, question=question,
        )  # fmt: skip

    def velocity(self, out: Array) -> Array:
        """Return v (nv,) of one state."""
        _, _, q, v = self._ends
        return out[q:v]

    @cached_property
    def equations(self) -> tuple[Equations, Linearisation]:
        """Equations of this core's scene, whatever the workspace is used for later."""
        return self.workspace.equations, self.workspace.linearisation

    def _converted(self, q: ArrayLike, v: ArrayLike, tau: ArrayLike) -> list[Array]:
        """Return the state as the core takes it, or raise `InvalidArgument`."""
        return [np.ascontiguousarray(x, float) for x in self._arguments.check(q, v, tau)]

    def _answer(
        self, work: Callable[..., None], state: State, outputs: Outputs, accuracy: float | None,
        forces: Sequence[AppliedForce], more: dict[str, Any],
    ) -> NDArray[np.intp]:  # fmt: skip
        q, v, tau = state
        clear = np.zeros(len(q), np.int32)
        work(
            q, v, contiguous(tau, len(q)), a=outputs["a"], lam=outputs["lam"],
            residuals=outputs["residuals"], iterations=outputs["iterations"], clear=clear,
            times=outputs["solve_times"], **more,
            **of_forces(self.workspace.loads, forces, len(q)),
            accuracy=self.workspace.solver.accuracy if accuracy is None else accuracy,
        )  # fmt: skip
        outputs["statuses"][:] = 0
        return np.flatnonzero(clear == 0)


def _private_copy(tau: ArrayLike) -> Array:
    """Torques (nv,) that the caller cannot write to."""
    return np.array(tau, dtype=float)


# Contacts that open, stick and slide as plain arrays, and what of them the compiled core has not.
#
# The places of the fields are those that ``native/src/core/contact_arrays.cpp`` reads.


def why_not_contacts(scene: Scene) -> Iterator[str]:
    """Yield the features of a scene's contacts that the core lacks, in words."""
    yield from _why_not_joints(scene.robot.model)
    pairs = [pair for bound in scene.contact_bounds for pair in bound.pairs]
    if cables := [line.name for bound in scene.contact_bounds for line in bound.lines]:
        yield f"{listed(cables)}: cables"
    if on_ground := [pair.name for pair in pairs if pair.surface is not None]:
        yield f"{listed(on_ground)}: shapes on a Ground"
    if fine := [p.name for p in pairs if p.shape.is_fine or p.ground_shape.is_fine]:
        yield f"{listed(fine)}: shapes of many edges, of which it would look at each"
    if wanders := [pair.name for pair in pairs if pair.ground_shape.is_plane]:
        yield f"{listed(wanders)}: contact points over a plane that depend on how a shape is turned"
    at_seams = [pair.name for pair, pieces in zip(pairs, pieces_of(pairs), strict=True) if pieces]
    if at_seams:
        yield f"{listed(at_seams)}: pieces of one body side by side, whose seams it would meet"


def of_contacts(scene: Scene, rank: int) -> dict[str, Any]:
    """Return the contacts of a scene; `rank` is that of its constraints."""
    bounds = scene.contact_bounds
    touches = [touch for bound in bounds for touch in bound.touches]
    pairs = [pair for bound in bounds for pair in bound.pairs]
    stops = [stop for bound in bounds for stop in bound.stops]
    dry = [each for bound in bounds for each in bound.dry]
    of_touches = [[*t.centre, t.radius, t.friction, *placement(t.plane)] for t in touches]
    of_pairs = [
        [*placement(p.placement), *placement(p.ground_placement), p.friction] for p in pairs
    ]
    shapes = [core for p in pairs for core in (p.shape, p.ground_shape)]
    return {
        "touches": np.array([[t.joint, t.ground] for t in touches], np.int32).reshape(-1, 2),
        "of_touches": np.array(of_touches, float).reshape(-1, 17),
        "pairs": np.array([[p.joint, p.ground] for p in pairs], np.int32).reshape(-1, 2),
        "of_pairs": np.array(of_pairs, float).reshape(-1, 25),
        "shapes": [_integers(core) for core in shapes],
        "of_shapes": [_numbers(core) for core in shapes],
        "stops": np.array([[s.iq, s.iv] for s in stops], np.int32).reshape(-1, 2),
        "of_stops": np.array([[s.sign, s.limit] for s in stops], float).reshape(-1, 2),
        "dry": np.array([each.iv for each in dry], np.int32),
        "of_dry": np.array([each.limit for each in dry], float),
        "rank": rank,
    }


def _integers(core: Core) -> NDArray[np.int32]:
    """Return the numbers of what a shape has, its edges, and its faces by their vertices."""
    counts = (len(core.vertices), len(core.edges), len(core.normals), len(core.directions))
    loops = [number for loop in core.loops for number in (len(loop), *loop)]
    return np.array([*counts, *core.edges.ravel(), *loops], np.int32)


def _numbers(core: Core) -> Array:
    """Return radius, size and reach of a shape, and where all that it has is."""
    parts = core.vertices, core.normals, core.heights, core.directions
    return np.concatenate([(core.radius, core.size, core.reach), *map(np.ravel, parts)])


# Derivatives of one answer, formed by the compiled core.


class CompiledDerivatives(KktDerivatives):
    """Derivatives as those of `KktDerivatives`, whose matrices are there already.

    What else may be asked for, derivatives by the parameters of a model, is as in Python. Of small
    robots it takes a tenth of all the time to make the solution: it is made when it is asked for.
    Each matrix is one view of what the core wrote, where those of the base class are two.
    """

    def __init__(self, core: CompiledCore, answer: Array, matrices: Array, tau: Array) -> None:
        self._core, self._answer, self._matrices, self._tau = core, answer, matrices, tau
        self._workspace, (self._equations, self._linearisation) = core.workspace, core.equations
        _, size, self._n = matrices.shape
        self._m, self._v = size - self._n, core.velocity(answer)

    @cached_property
    def solution(self) -> Solution:  # type: ignore[override]
        """The answer."""
        return self._core.solution(self._answer, self._tau)

    @property
    def _blocks(self) -> tuple[Array, Array, Array]:
        by_q, by_v, by_tau = self._matrices
        return by_q, by_v, by_tau

    def block(self, output: str, by: str) -> Array:
        """Return the derivative of a (nv, nv) or lam (m, nv) by q, v or tau."""
        rows = slice(self._n) if output == "a" else slice(self._n, None)
        return self._matrices[self.inputs.index(by), rows]

    _forward, _backward = Derivatives._forward, Derivatives._backward


# Recursions over a tree whose bodies are held at the world: `constrainedABA` and `pv`, compiled.
#
# A scene crosses the border as numbers: what is compiled has a Pinocchio of its own.


class CompiledMethod:
    """A compiled method bound to one model with the constraints of a scene.

    name: one of ``methods`` of the compiled module
    mu: [1/kg]
    accuracy: what ends the iterations: the method says of what
    limit: of iterations
    module: where it is compiled; `constrained_aba` by default
    """

    def __init__(
        self,
        name: str,
        model: Any,
        constraints: Sequence[PinocchioConstraint],
        drift: Baumgarte | None,
        *,
        mu: float,
        accuracy: float,
        limit: int,
        module: Any = None,
    ) -> None:
        module = module or constrained_aba()
        numbers = _of_model(model, module.joints) | _of_constraints(constraints, drift)
        settings = {"mu": float(mu), "accuracy": float(accuracy), "limit": int(limit)}
        self.bound = module.Bound(name, **numbers, **settings)
        self.iterations, self._nv = 0, int(model.nv)
        self._rows = sum(c.size for c in constraints)

    def acceleration(self, q: Array, v: Array, tau: Array) -> Array:
        """Return a (nv,); Singular where the matrix of the method is not positive definite."""
        a = np.empty(self._nv)
        self.iterations = self.bound.solve(q, v, tau, a)
        if not self.iterations:
            raise Singular
        return a

    def many(self, Q: Array, V: Array, TAU: Array) -> Array:
        """Return a (k, nv) of k states, without the GIL; NaN where `acceleration` is `Singular`."""
        A = np.empty((len(Q), self._nv))
        self.bound.solve_many(Q, V, TAU, A)
        return A

    def lam(self) -> Array:
        """Return the forces of Pinocchio's rows."""
        lam = np.empty(self._rows)
        self.bound.lam(lam)
        return lam


def _of_model(model: Any, compiled: Collection[str]) -> dict[str, Any]:
    """Return all numbers of a model that the equations read, for any compiled joint."""
    q = pin.neutral(model)
    subspaces = np.zeros((model.njoints - 1, 6, 2))
    for S, joint in zip(subspaces, list(model.joints)[1:], strict=True):
        if joint.shortname() not in compiled:
            raise UnsupportedBackend(
                f"joint {model.names[joint.id]!r} is a {joint.shortname()}, which is not compiled "
                "in condyn_pin_native; use LCABA() or Proximal()"
            )
        if joint.nv <= 2:  # what larger joints move along is said by their kind
            S[:, : joint.nv] = axes(joint, q)
    numbers = of_model(model)
    bodies = numbers["joints"][:, 3:]  # behind one axis, which does for joints of one coordinate
    return {
        "kinds": numbers["kinds"],
        "parents": numbers["parents"].tolist(),
        "joints": np.hstack([subspaces.reshape(-1, 12), bodies]),
        "gravity": numbers["gravity"],
        "armature": numbers["armature"],
    }


def _of_constraints(
    constraints: Sequence[PinocchioConstraint], drift: Baumgarte | None
) -> dict[str, Any]:
    """Return the constraints as Pinocchio takes them, with the gains of drift control."""
    integers = [(c.size, c.joint1, c.joint2) for c in constraints]
    none = Baumgarte(0.0, 0.0)
    of_each = [(c.drift or drift) if drift else none for c in constraints]
    numbers = [
        (*placement(c.placement1), *placement(c.placement2), d.Kp if c.anchored else 0.0, d.Kd)
        for c, d in zip(constraints, of_each, strict=True)
    ]
    return {
        "constraint_integers": np.array(integers, np.int32).reshape(-1, 3),
        "constraint_numbers": np.array(numbers, float).reshape(-1, 26),
    }
