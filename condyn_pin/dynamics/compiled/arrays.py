"""A scene as plain arrays, and what of it the compiled core does not take.

No object of Pinocchio crosses the border: kinds of joints by their names, everything else as
numbers. ``native/src/core`` reads them; the places of its fields are those here.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import inf
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import LOOSE
from condyn_pin._core.arrays import Array
from condyn_pin._core.joints import axes, indices
from condyn_pin._core.trees import is_forest
from condyn_pin.constraints.rows.bound import placement
from condyn_pin.constraints.rows.redundancy import Redundancy
from condyn_pin.dynamics.solvers.base import Solver
from condyn_pin.dynamics.solvers.dense_kkt import DenseKKT
from condyn_pin.dynamics.solvers.null_space import NullSpace
from condyn_pin.dynamics.solvers.proximal import Proximal

if TYPE_CHECKING:
    from condyn_pin.constraints.baumgarte import Baumgarte
    from condyn_pin.constraints.forces import AppliedForce, Loads
    from condyn_pin.constraints.rows.bound import AnyBound
    from condyn_pin.dynamics.residuals import ErrorEstimator
    from condyn_pin.dynamics.scene import Scene
    from condyn_pin.dynamics.workspace import Workspace
    from condyn_pin.model.robot import Robot

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


def untaken(workspace: Workspace) -> Iterator[str]:
    """Yield what the core does not take of a workspace, in words."""
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
    yield from untaken_rows(workspace.model, workspace.bounds)


def untaken_rows(model: Any, bounds: Sequence[AnyBound]) -> Iterator[str]:
    """Yield what the core does not take of a model and its constraints, in words."""
    if is_forest(model):
        yield f"{model.nv} degrees of freedom of many trees: it keeps no memory for each of them"
    for name, joint in zip(model.names, model.joints, strict=True):
        if joint.id and joint.shortname() not in JOINTS:
            yield f"joint {name!r} is a {joint.shortname()}, which it was not compiled for"
    for bound in bounds:
        if bound.compiled() is None:
            yield f"constraint {bound.name!r}: it has no rows for a {type(bound).__name__}"


def of_model(model: Any) -> dict[str, Any]:
    """Return everything about a model that the equations read."""
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
    """Return the springs: of joints stiffness and reference, and where q and v hold each.

    Between frames the joints that these are on, their origins there, and what acts along the line.
    """
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


def of_rows(bounds: Sequence[AnyBound], drift: Baumgarte | None) -> dict[str, Any]:
    """Return the rows of a scene, and the gains that draw them back."""
    rows = [made for bound in bounds if (made := bound.compiled())]
    return {
        "constraints": np.array([ints for ints, _ in rows], np.int32).reshape(-1, 14),
        "of_constraints": np.array([numbers for _, numbers in rows], float).reshape(-1, 27),
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
    """Return how it answers, what `Proximal` iterates with, and what answers are judged by."""
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
    """Return what answers are judged by, as `ErrorEstimator.prove` and `Verifier` do."""
    of_residuals = by.gravity, by.largest_weight, by.per_row, by.rounding, *by.leaning_rounding
    of_doubts = (
        by.negligible_constraint_error,
        by.plausible_acceleration,
        by.plausible_force,
        by.negligible_dynamics_error,
    )
    return np.array([*of_residuals, *of_doubts, tolerances.SOLVED, LOOSE, _LARGEST])


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
