"""Boundary to the compiled core: a scene as named fields, answers back.

CompiledCore: a workspace whose hot loops are compiled.

What the core answers is what Python would: the same Pinocchio, the same numbers, and the proof by
the same equations. Where the proof of a state leaves a doubt, or the iteration ends at nothing,
the state is answered by Python: hard cases are handled in one place only.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from functools import cached_property
from math import inf
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import QUATERNION_TOLERANCE, State, listed
from condyn_pin._core.arrays import Array
from condyn_pin._core.compiled import compiled, constrained_aba, has_core, refuse
from condyn_pin._core.models import axes, indices, is_forest
from condyn_pin.constraints.contacts.candidates import pieces_of
from condyn_pin.constraints.drift import Baumgarte
from condyn_pin.constraints.forces import AppliedForce, Loads
from condyn_pin.constraints.rows.bound import BoundConstraint, PinocchioConstraint
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

# A scene in the fields that the core reads, and what of it the core lacks.
#
# No object of Pinocchio crosses the border but placements, whose rotation and translation are read.
# ``native/src/fields.hpp`` reads keys of dictionaries, and attributes of what is bound: contacts,
# constraints of Pinocchio, shapes.


# No acceleration of a machine, as in `Workspace`.
_LARGEST: Final = 1e100

# Solvers that are exact, and so is what the core has in their place: nothing but rounding tells
# them from it.
_DIRECT: Final[tuple[Solver, ...]] = (DenseKKT(), NullSpace())
_METHODS: Final = ("independent", "minimum_norm")


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
    if not has_core():  # it says which joints it was compiled for
        return
    for joint in _others(model, compiled().joints):
        yield f"{joint}, which it was not compiled for"


def _others(model: Any, kinds: Collection[str]) -> Iterator[str]:
    """Yield the joints of other kinds, in words."""
    for name, joint in zip(model.names, model.joints, strict=True):
        if joint.id and joint.shortname() not in kinds:
            yield f"joint {name!r} is a {joint.shortname()}"


def describe_tree(model: Any) -> dict[str, Any]:
    """Joints and bodies of a model, for any compiled joint."""
    q = pin.neutral(model)
    joints = []
    for joint, placement, Y, parent in zip(
        *(list(each)[1:] for each in (model.joints, model.jointPlacements, model.inertias)),
        list(model.parents)[1:], strict=True,
    ):  # fmt: skip
        subspace = np.zeros((6, 2))
        if joint.nv <= 2:  # larger joints move as their kind says
            subspace[:, : joint.nv] = axes(joint, q)
        joints.append({
            "kind": joint.shortname(), "parent": parent, "subspace": subspace,
            "placement": placement, "mass": Y.mass, "lever": Y.lever, "inertia": Y.inertia,
        })  # fmt: skip
    return {"joints": joints, "gravity": model.gravity.linear, "armature": model.armature}


def describe_rows(
    model: Any, bounds: Sequence[BoundConstraint], drift: Baumgarte | None
) -> dict[str, Any]:
    """Tree and constraints of a scene, and the gains of its drift control."""
    return {
        "tree": describe_tree(model),
        "constraints": [rows for bound in bounds if (rows := bound.compiled())],
        "kp": drift.Kp if drift else 0.0,
        "kd": drift.Kd if drift else 0.0,
    }


def describe(workspace: Workspace) -> dict[str, Any]:
    """Scene of a workspace, its solver, and the constants of the error check."""
    scene, equations, solver = workspace.scene, workspace.equations, workspace.solver
    nominal, found = scene.nominal, workspace.pinocchio_constraints
    plain = found.constraints if isinstance(solver, Proximal) else ()
    return {
        **describe_rows(workspace.model, workspace.bounds, workspace.drift),
        **_describe_springs(scene.robot),
        "plain": plain,
        "to_scene": np.zeros((0, 0)) if not plain or found.to_scene is None else found.to_scene,
        "wanted": equations.wanted_at(None) if equations.is_driven else np.zeros((3, 0)),
        "method": _METHODS[_DIRECT.index(solver)] if solver in _DIRECT else "proximal",
        "proximal": _describe_proximal(workspace),
        "weights": nominal.estimator.weights,
        "verdict": _describe_verdict(nominal.estimator),
        "open_squared": tolerances.OPEN**2,
        "watched": nominal.pivots.watched,
        "nominal_pivots": nominal.pivots.nominal,
        "dependent": nominal.dependent,
        "least_squared": equations.least,
        "precision": _describe_precision(scene),
    }


def _describe_springs(robot: Robot) -> dict[str, Any]:
    chosen = [spring for spring in robot.springs if spring.stiffness]
    at_q, at_v = indices(robot.model, [spring.joint for spring in chosen])
    between = []
    for each in robot.spring_dampers:
        if each.stiffness or each.damping:
            (joint_a, a), (joint_b, b) = robot.frame(each.frame_a), robot.frame(each.frame_b)
            between.append({
                "joint_a": joint_a, "joint_b": joint_b, "a": a.translation, "b": b.translation,
                "stiffness": each.stiffness, "damping": each.damping,
                "rest_length": each.rest_length,
            })  # fmt: skip
    springs = [
        {"at_q": q, "at_v": v, "stiffness": spring.stiffness, "reference": spring.reference}
        for spring, q, v in zip(chosen, at_q, at_v, strict=True)
    ]
    return {"damping": robot.model.damping, "springs": springs, "between": between}


def _describe_proximal(workspace: Workspace) -> dict[str, Any]:
    solver = workspace.solver
    if not isinstance(solver, Proximal):
        zero = {"absolute": 0.0, "relative": 0.0, "mu": 0.0, "limit": 0}
        return {**zero, "adaptive": False}
    mu, accuracy, limit, adaptive, _ = solver.iteration(workspace.scene.nominal)
    return {
        "absolute": solver.absolute_accuracy, "relative": accuracy, "mu": mu, "limit": limit,
        "adaptive": adaptive,
        "better": solver.mu_at_state(workspace).better if adaptive else {},
    }  # fmt: skip


def _describe_precision(scene: Scene) -> dict[str, Any]:
    """Scales of rows and moves, and where rows are judged at the precision of a state."""
    nominal, is_judged = scene.nominal, scene.rows and scene.robot.precision > 0.0
    every_row = Redundancy(np.ones(scene.rows), np.ones(scene.robot.nv), 0, 0.0, 1.0)
    by, gap = (nominal.redundancy, tolerances.OPEN) if is_judged else (every_row, inf)
    return {
        "row_scales": by.R, "move_scales": by.D, "floor": by.floor, "least": by.least,
        "share": tolerances.REFERENCE_RANK, "open": gap,
        "moving": gap if nominal.dependent else inf,
        "ajar": tolerances.AJAR if is_judged else inf, "doubt": tolerances.DOUBT, "size": by.size,
        "looks_independent": nominal.looks_independent, "idle": np.flatnonzero(nominal.idle),
    }  # fmt: skip


def _describe_verdict(by: ErrorEstimator) -> dict[str, float]:
    """Constants of the error check, as in `ErrorEstimator.prove` and `Verifier`."""
    leaning, leaning_forces = by.leaning_rounding
    own = (
        "gravity", "largest_weight", "per_row", "rounding", "negligible_constraint_error",
        "plausible_acceleration", "plausible_force", "negligible_dynamics_error",
    )  # fmt: skip
    return {
        **{name: getattr(by, name) for name in own},
        "leaning": leaning, "leaning_forces": leaning_forces, "solved": tolerances.SOLVED,
        "loose": QUATERNION_TOLERANCE, "fastest": _LARGEST,
    }  # fmt: skip


def describe_forces(loads: Loads, forces: Sequence[AppliedForce], count: int) -> dict[str, Any]:
    """Forces from outside at some states: where they act, and six numbers of each at each state."""
    bound = loads.bind([force.row(0) for force in forces]) if count else ()
    wrenches = np.zeros((count, 6 * len(bound)))
    for k, force in enumerate(forces[: len(bound)]):
        wrenches[:, 6 * k : 6 * k + force.numbers.shape[-1]] = force.numbers
    return {"pushes": bound, "wrenches": wrenches}


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
        n, m = workspace.model.nv, self._scene.rows
        self._blocks = 3, n + m, n
        self.core = compiled().Core(**describe(workspace))
        parts = self.core.parts  # of what comes back of one state
        self._a, self._lam, self._q, self._v, self._residuals, self._iterations, self._time = (
            parts[name] for name in ("a", "lam", "q", "v", "residuals", "iterations", "solve_time")
        )
        self._size = self._time.stop
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
        return said and self._solution(out, tau, said)

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
        said = {
            "residuals": out[self._residuals].tolist(),
            "iterations": int(out[self._iterations].item()),
            "solve_time": out[self._time].item(),
        }
        return self._solution(out, tau, said)

    def _solution(self, out: Array, tau: ArrayLike, said: dict[str, Any]) -> Solution:
        question = Question(
            out[self._q], out[self._v], _private_copy(tau), (), self.workspace.drift
        )
        return Solution(
            a=out[self._a], lam=out[self._lam], residuals=Residuals._make(said["residuals"]),
            status=_OK, iterations=said["iterations"], solve_time=said["solve_time"],
            scene=self._scene, question=question,
        )  # fmt: skip

    def velocity(self, out: Array) -> Array:
        """Return v (nv,) of one state."""
        v: Array = out[self._v]
        return v

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
            Q=q, V=v, TAU=contiguous(tau, len(q)), a=outputs["a"], lam=outputs["lam"],
            residuals=outputs["residuals"], iterations=outputs["iterations"], clear=clear,
            times=outputs["solve_times"], **more,
            **describe_forces(self.workspace.loads, forces, len(q)),
            accuracy=self.workspace.solver.accuracy if accuracy is None else accuracy,
        )  # fmt: skip
        outputs["statuses"][:] = 0
        return np.flatnonzero(clear == 0)


def _private_copy(tau: ArrayLike) -> Array:
    """Torques (nv,) that the caller cannot write to."""
    return np.array(tau, dtype=float)


# Contacts that open, stick and slide, and what of them the compiled core lacks.


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


def describe_contacts(scene: Scene, rank: int) -> dict[str, Any]:
    """Contacts of a scene, as they are bound; `rank` is that of its constraints."""
    bounds = scene.contact_bounds
    found: dict[str, Any] = {
        kind: [each for bound in bounds for each in getattr(bound, kind)]
        for kind in ("touches", "pairs", "stops", "dry")
    }
    return found | {"rank": rank}


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
# What is compiled has a Pinocchio of its own.


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
        for joint in _others(model, module.joints):
            raise UnsupportedBackend(
                f"{joint}, which is not compiled in condyn_pin_native; use LCABA() or Proximal()"
            )
        self.bound = module.Bound(
            name, tree=describe_tree(model), mu=mu, accuracy=accuracy, limit=limit,
            constraints=[_with_gains(each, drift) for each in constraints],
        )  # fmt: skip
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


def _with_gains(constraint: PinocchioConstraint, drift: Baumgarte | None) -> dict[str, Any]:
    """Constraint as Pinocchio has it, with the gains of drift control."""
    by = (constraint.drift or drift) if drift else Baumgarte(0.0, 0.0)
    return {
        "size": constraint.size,
        "joint1": constraint.joint1, "placement1": constraint.placement1,
        "joint2": constraint.joint2, "placement2": constraint.placement2,
        "kp": by.Kp if constraint.anchored else 0.0, "kd": by.Kd,
    }  # fmt: skip
