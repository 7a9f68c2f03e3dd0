"""The terms and the accelerations against MuJoCo, an engine that shares no code with Pinocchio.

The referee is proved first, on a tree with every joint it knows and with plain Pinocchio; then it
judges condyn_pin at states that satisfy the constraints, moving along them.
"""

from __future__ import annotations

import functools
import itertools
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from referee import MujocoReferee, truncated_svd
from scipy.linalg import block_diag
from shared import CHOSEN_ROBOTS
from test_bridge import every_joint

import condyn_pin as cp

# Two engines that round differently: 1e-15 a term, times the conditioning of Cassie, whose rods
# spin with 1e-7 of the trunk's inertia. Measured: 3e-12 at worst.
AGREES = 1e-10
SEEDS = (0, 1, 2)
HELD = (cp.PointContact, cp.SurfaceContact)  # what MuJoCo can hold where it is


def relative_error(x: np.ndarray, reference: np.ndarray, floor: float = 0.0) -> float:
    assert x.shape == reference.shape
    return np.abs(x - reference).max() / max(np.abs(reference).max(), floor) if x.size else 0.0


def mass_error(M: np.ndarray, reference: np.ndarray) -> float:
    """Error of each entry relative to √(Mᵢᵢ Mⱼⱼ), so that light links count like heavy ones."""
    scale = np.sqrt(np.diag(reference))
    return np.abs((M - reference) / np.outer(scale, scale)).max()


def projector(J: np.ndarray) -> np.ndarray:
    """Projector onto the row space of J."""
    _, _, B = truncated_svd(J)
    return B @ B.T


# The referee, against plain Pinocchio


def random_state(model: pin.Model, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    displacement, v = rng.normal(size=(2, model.nv))
    return pin.integrate(model, pin.neutral(model), displacement), v


@pytest.mark.parametrize("seed", SEEDS)
def test_referee_knows_every_joint(seed: int) -> None:
    model = every_joint().model
    q, v = random_state(model, seed)
    referee = MujocoReferee(cp.Robot("every joint", model))
    M = pin.crba(model, model.createData(), q)
    M = np.triu(M) + np.triu(M, 1).T
    h = pin.nonLinearEffects(model, model.createData(), q, v)
    assert mass_error(referee.mass_matrix(q), M) < AGREES
    assert relative_error(referee.bias(q, v), h) < AGREES


@pytest.mark.parametrize("seed", SEEDS)
def test_referee_differentiates_loops(seed: int) -> None:
    """J and J̇v of two tips, less each other, hold in any state, be the loop open or closed."""
    model = every_joint().model
    q, v = random_state(model, seed)
    foot, hand = 4, 9
    tip = pin.exp6(np.array([0.3, 0.1, 0.0, 0.2, 0.0, 0.1]))
    robot = cp.Robot("every joint", with_tips(model, foot, hand, tip))
    referee = MujocoReferee(replace(robot, loops=[cp.Loop("tip4", "tip9", "weld")]))
    J, drift = zip(*(tip_motion(model, q, v, joint, tip) for joint in (foot, hand)), strict=True)
    assert relative_error(referee.loop_jacobian(q), J[0] - J[1]) < AGREES
    assert relative_error(referee.loop_acceleration_drift(q, v), drift[0] - drift[1]) < AGREES


def with_tips(model: pin.Model, foot: int, hand: int, tip: pin.SE3) -> pin.Model:
    for joint in (foot, hand):
        model.addFrame(pin.Frame(f"tip{joint}", joint, 0, tip, pin.FrameType.OP_FRAME))
    return model


def tip_motion(
    model: pin.Model, q: np.ndarray, v: np.ndarray, joint: int, tip: pin.SE3
) -> tuple[np.ndarray, np.ndarray]:
    """Jacobian of a tip in world axes, and its acceleration when a = 0."""
    model, axes = pin.Model(model), pin.LOCAL_WORLD_ALIGNED
    frame = model.addFrame(pin.Frame("tip", joint, 0, tip, pin.FrameType.OP_FRAME))
    data = model.createData()
    J = pin.computeFrameJacobian(model, data, q, frame, axes)
    pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
    return J, pin.getFrameClassicalAcceleration(model, data, frame, axes).vector


# The scenes that it judges


def scenes_of(name: str) -> dict[str, cp.Scene]:
    """Every robot with all that it brings, and closed chains also without the ground."""
    robot = cp.load_robot(name)
    if robot.contacts and not all(isinstance(c, HELD) for c in robot.contacts):
        return {f"{name} in the air": cp.Scene(robot, robot.loops)}  # it has no rolling rows
    scenes = {name: cp.Scene(robot, (*robot.loops, *robot.contacts))}
    if robot.loops and robot.contacts:
        scenes[f"{name} in the air"] = cp.Scene(robot, robot.loops)
    return scenes


# What MuJoCo cannot have, and what it says to that.
REFUSED = {
    "sleigh": ("a planar joint", "which MuJoCo does not have"),
}

SCENES = {
    label: scene
    for name in cp.io.available_robots()
    if name not in REFUSED
    for label, scene in scenes_of(name).items()
}


class Case:
    """A scene in one random state, and its referee."""

    def __init__(self, scene: cp.Scene, seed: int):
        rng = np.random.default_rng(seed)
        model = scene.robot.model
        self.scene = scene
        self.q, v = scene.sample(rng)
        self.v = v / min(1.0, np.abs(v).max())  # at rest nothing would test J̇v
        self.tau = motor_torque(scene.robot, rng)
        self.terms = cp.Workspace(scene, cp.dynamics.Reference()).terms(self.q, self.v)
        data = model.createData()
        pin.forwardKinematics(model, data, self.q)
        self.referee = MujocoReferee(held(scene, data))
        axes = (axes_of_rows(scene.robot, data, c) for c in scene.constraints)
        self.to_world = block_diag(np.zeros((0, 0)), *axes)


def held(scene: cp.Scene, data: pin.Data) -> cp.Robot:
    """Return the robot with the scene's constraints as loops; a contact holds where it is."""
    robot, loops = scene.robot, []
    for constraint in scene.constraints:
        if isinstance(constraint, cp.Loop | cp.constraints.Coupling):
            loops.append(constraint)
            continue
        point = getattr(constraint, "offset", (0.0, 0.0, 0.0))
        name = constraint.name
        robot = robot.with_frame(f"{name}_moving", constraint.frame, point)
        joint, placement = robot.frame(f"{name}_moving")
        here = data.oMi[joint] * placement
        robot = robot.with_frame(f"{name}_held", "world", here.translation, here.rotation)
        kind = "ball" if constraint.rows == 3 else "weld"
        loops.append(cp.Loop(f"{name}_moving", f"{name}_held", kind, name=name))
    return replace(robot, loops=loops)


def axes_of_rows(
    robot: cp.Robot, data: pin.Data, constraint: cp.constraints.Constraint
) -> np.ndarray:
    """Rotation of the first frame, in whose axes the rows of condyn_pin are, once per 3 rows."""
    if isinstance(constraint, cp.constraints.Coupling):
        return np.eye(1)
    first = constraint.frame_a if isinstance(constraint, cp.Loop) else constraint.frame
    joint, placement = robot.frame(first)
    R = (data.oMi[joint] * placement).rotation
    return R if constraint.rows == 3 else block_diag(R, R)


def motor_torque(robot: cp.Robot, rng: np.random.Generator) -> np.ndarray:
    """Some 10 N m on each motor: on a free rod they would drown all the rest in its spin."""
    tau = np.zeros(robot.nv)
    for name in robot.actuated:
        tau[robot.model.joints[robot.model.getJointId(name)].idx_v] = rng.normal(scale=10.0)
    return tau


@functools.cache
def case_of(label: str, seed: int) -> Case:
    return Case(SCENES[label], seed)


CHOSEN = {(label, 0) for label in SCENES if label.split()[0] in CHOSEN_ROBOTS}
CASES = [
    pytest.param(case, marks=() if case in CHOSEN else pytest.mark.long)
    for case in itertools.product(SCENES, SEEDS)
]


@pytest.fixture(params=CASES, ids=str)
def case(request: pytest.FixtureRequest) -> Case:
    return case_of(*request.param)


@pytest.mark.parametrize("name", REFUSED)
def test_what_mujoco_refuses(name: str) -> None:
    _, said = REFUSED[name]
    with pytest.raises(ValueError, match=said):
        MujocoReferee(cp.load_robot(name))


def test_state_satisfies_constraints(case: Case) -> None:
    """Off the manifold two right formulas differ, so MuJoCo has to see it closed as well."""
    violation, J = case.referee.equality(case.q)
    assert np.abs(violation).max(initial=0.0) < AGREES
    assert np.abs(J @ case.v).max(initial=0.0) < AGREES


def test_armature_is_part_of_the_trial() -> None:
    assert cp.load_robot("talos").model.armature.any()


def test_mass_matrix(case: Case) -> None:
    assert mass_error(case.terms.M, case.referee.mass_matrix(case.q)) < AGREES


def test_bias(case: Case) -> None:
    bias = case.referee.bias(case.q, case.v)
    assert relative_error(case.terms.h, bias, floor=1e-3) < AGREES  # what rolls upright has none


def test_loop_jacobian(case: Case) -> None:
    assert relative_error(case.to_world @ case.terms.J, case.referee.loop_jacobian(case.q)) < AGREES


def test_rows_of_mujocos_own_constraints(case: Case) -> None:
    """MuJoCo's `connect` and `weld` forbid the same motions, whatever the axes of their rows."""
    _, J = case.referee.equality(case.q)
    assert J.shape == case.terms.J.shape
    assert np.abs(projector(case.terms.J) - projector(J)).max() < AGREES


def test_acceleration_drift(case: Case) -> None:
    drift = case.referee.loop_acceleration_drift(case.q, case.v)
    one_metre = np.abs(case.v).max() ** 2  # equal cranks side by side drift alike: γ = 0
    assert relative_error(case.to_world @ case.terms.gamma, drift, one_metre) < AGREES


def test_constrained_acceleration(case: Case) -> None:
    a = cp.solve(case.scene, case.q, case.v, case.tau, solver=cp.dynamics.Reference()).a
    expected = case.referee.constrained_acceleration(case.q, case.v, case.tau)
    assert relative_error(a, expected) < AGREES
