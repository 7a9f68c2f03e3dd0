"""Springs that a controller takes for rigid: what it damps must not swing them up."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray
from shared import all_scenes, each_scene, robot

import condyn_pin as cp
from condyn_pin._core import tolerances
from condyn_pin._core.linalg import factorise, least_change
from condyn_pin.contact import FrictionCone
from condyn_pin.control import CenterOfMass, Controller, FrameTask, Orientation, Posture
from condyn_pin.control.limits import locked_velocity
from condyn_pin.dynamics.solution import Sites
from condyn_pin.mechanism import project_velocity

pytest.importorskip("proxsuite")

Array = NDArray[np.float64]
M_1, M_2, OMEGA = 3.0, 1.0, 200.0  # [kg, kg, rad/s]: a motor, a load, and the spring between them
M = M_1 + M_2
ALPHA, BETA = 10.0, 15.0  # [1/s]


def two_masses() -> cp.Scene:
    model = pin.Model()
    parent = 0
    for name, mass in (("motor", M_1), ("load", M_2)):
        parent = model.addJoint(parent, pin.JointModelPX(), pin.SE3.Identity(), name)
        inertia = pin.Inertia(mass, np.zeros(3), np.zeros((3, 3)))
        model.appendBodyToJoint(parent, inertia, pin.SE3.Identity())
        model.addJointFrame(parent)
    stiffness = OMEGA**2 * M_1 * M_2 / M
    springs = [cp.model.Spring("load", stiffness)]
    return cp.Scene(cp.Robot("two masses", model, actuated=["motor"], springs=springs))


def closed_loop(scene: cp.Scene, controller: Controller) -> Array:
    """Return the matrix of the motion: everything is linear."""

    def rates(x: Array) -> Array:
        q, v = x[:2], x[2:]
        passive = scene.robot.passive_torque(q, v)
        out = controller.solve(q, v, passive=passive)
        assert out.status.ok
        return np.concatenate((v, cp.solve(scene, q, v, out.tau + passive).a))

    return np.array([rates(x) for x in np.eye(4)]).T


def test_two_masses_and_a_spring_by_hand() -> None:
    """p^4 + 2 alpha p^3 + Omega^2 (p^2 + 2 alpha p + beta^2), and not without the cubic term."""
    scene = two_masses()
    tasks = [FrameTask("load", reference=(0, 0, 0), kp=BETA**2, kd=2 * ALPHA)]
    stiff = Controller(scene, tasks, cones={}, rigid=["load"], regularisation=1e-12)
    slow = (OMEGA**2, 2 * ALPHA * OMEGA**2, (BETA * OMEGA) ** 2)
    found = np.linalg.eigvals(closed_loop(scene, stiff))
    by_hand = np.roots([1.0, 2 * ALPHA, *slow])
    assert np.sort_complex(found) == pytest.approx(np.sort_complex(by_hand), rel=1e-6)
    fast = np.abs(found) > OMEGA / 2
    assert found[fast].real.max() < 1.1 * ALPHA * (BETA / OMEGA) ** 2
    # a controller that damps what the spring carries would swing it up as fast as it damps
    seen = np.roots([1.0, 0.0, *slow])
    assert seen.real.max() == pytest.approx(ALPHA, rel=0.02)


@pytest.mark.long
def test_what_is_locked_keeps_its_momentum() -> None:
    """And nothing else changes where the springs stand still."""
    scene = two_masses()
    tasks = [FrameTask("load", reference=(0, 0, 0), kp=BETA**2, kd=2 * ALPHA)]
    stiff = Controller(scene, tasks, cones={}, rigid=["load"])
    v = np.array([0.3, -2.0])
    out = stiff.solve(np.zeros(2), v)
    assert out.v == pytest.approx([v[0] + M_2 / M * v[1], 0.0], abs=1e-15)
    still = np.array([0.3, 0.0])
    assert (stiff.solve(np.zeros(2), still).v == still).all()


def test_rows_that_depend_on_each_other_lock_as_singular_values_say() -> None:
    """Rods of Cassie spin, so that two of her twelve rows of loops say nothing."""
    loops, stiff, q, v = cassie()
    program = stiff._program
    J, M = Sites(loops, q).jacobian, program.equations.mass(q)
    rows = np.vstack((J, program.rigid))
    M = M + M.diagonal().mean() * (rows.T @ rows)
    change = np.concatenate((np.zeros(len(J)), -(program.rigid @ v)))
    factors = factorise(M, rows, tolerances.RANK)
    assert factors.rank == len(rows) - 2
    by_values = factors.solve(np.zeros_like(v), change)[0]
    by_pivots = least_change(factors.mass, rows, change, tolerances.RANK)
    assert by_pivots == pytest.approx(by_values, abs=1e-12)
    assert np.abs(by_pivots).max() > 0.1
    # rows a million times as small, as those of a rod's spin, are rows as well
    small = np.where(np.arange(len(rows)) % 3, 1.0, 1e-6)
    again = least_change(factors.mass, small[:, None] * rows, small * change, tolerances.RANK)
    assert again == pytest.approx(by_values, abs=1e-8)


@pytest.mark.long
def test_rows_that_have_no_cone_are_formed_alone() -> None:
    _, stiff, q, _ = cassie()
    program, still = stiff._program, np.zeros(32)
    wanted = program.equations.position_level(q)[1][program.cones.held]
    assert program._held is not None
    assert len(wanted) == program._held.m == 12 < program.equations.m
    program._held.motion(pin.neutral(program._held.model), still, still)  # it leaves nothing behind
    np.testing.assert_array_equal(program._held.jacobian(q), wanted)


@pytest.mark.long
@each_scene
def test_the_jacobian_of_points_and_frames_needs_no_motion(label: str) -> None:
    scene = all_scenes()[label]
    equations = cp.Workspace(scene).equations
    (q, v), (other, _) = (scene.sample(np.random.default_rng(seed)) for seed in (0, 1))
    wanted = equations.position_level(q)[1]
    equations.errors(other, v, 0 * v, v, np.ones(scene.rows))
    np.testing.assert_array_equal(equations.jacobian(q), wanted)
    assert equations.answer == b""  # wrenches of another state are not taken for its own


@pytest.mark.long
def test_springs_may_carry_links_without_mass() -> None:
    """M alone is singular there; the momentum is that of the motor."""
    M = np.diag([M_1, 0.0])
    w = locked_velocity(np.array([0.3, -2.0]), M, np.zeros((0, 2)), np.array([[0.0, 1.0]]))
    assert w == pytest.approx([0.3, 0.0], abs=1e-15)


def cassie(engine: str = "python") -> tuple[cp.Scene, Controller, Array, Array]:
    """Return Cassie, its controller, and a state in which its springs swing and its loops hold."""
    made = robot("cassie")
    loops, scene = cp.Scene(made, made.loops), cp.Scene(made, [*made.loops, *made.contacts])
    q, _ = scene.state()
    v = project_velocity(loops, q, 0.3 * np.random.default_rng(3).normal(size=made.nv))
    springs = [spring.joint for spring in made.springs]
    tasks = [CenterOfMass(weight=100), Orientation("pelvis", weight=50), Posture(weight=0.1)]
    cone = FrictionCone(0.6, sides=8)
    return loops, Controller(scene, tasks, cones=cone, rigid=springs, engine=engine), q, v


@pytest.mark.long
def test_springs_in_loops_are_locked_by_forces_of_loops_and_springs_alone(engine) -> None:
    loops, stiff, q, v = cassie(engine.name)
    out = stiff.solve(q, v)
    assert out.status.ok
    model = loops.robot.model
    names = [spring.joint for spring in loops.robot.springs]
    springs = np.eye(model.nv)[[model.joints[model.getJointId(name)].idx_v for name in names]]
    assert np.abs(springs @ v).min() > 1e-3
    assert np.abs(springs @ out.v).max() < 1e-12
    J = Sites(loops, q).jacobian
    assert np.abs(J @ (out.v - v)).max() < 1e-12
    half = np.triu(pin.crba(model, model.createData(), q))
    impulse = (half + np.triu(half, 1).T) @ (out.v - v)
    rows = np.vstack((J, springs)).T
    left = impulse - rows @ np.linalg.lstsq(rows, impulse, rcond=None)[0]
    assert np.abs(left).max() < 1e-10 < 1e-2 < np.abs(impulse).max()


@pytest.mark.long
def test_numbers_that_are_not_finite_are_refused_as_before() -> None:
    scene = two_masses()
    stiff = Controller(scene, [FrameTask("load")], cones={}, rigid=["load"])
    with pytest.raises(cp.InvalidArgument, match=r"v\[1\] = nan"):
        stiff.solve(np.zeros(2), [0.0, np.nan])
    with pytest.raises(cp.InvalidArgument, match=r"q\[0\] = inf"):
        stiff.solve([np.inf, 0.0], [0.0, 1.0])
