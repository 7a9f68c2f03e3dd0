"""Whole-body control: closed forms, limits and cones, switching, strict levels, what is refused."""

from __future__ import annotations

import functools
import pickle
import re
from dataclasses import replace

import numpy as np
import pytest
from motions import body
from own_task import nearest, own_task, still
from shared import each_row, robot

import condyn_pin as cp
from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin.contact import FrictionCone, WrenchCone, margins
from condyn_pin.control import (
    DAQP,
    QPS,
    TASKS,
    Actuation,
    AngularMomentum,
    CapturePoint,
    CenterOfMass,
    CentredPressure,
    ContactForce,
    Controller,
    ControlLimits,
    ControlStatus,
    FrameTask,
    Hierarchy,
    JointTask,
    LargestMargin,
    LeastNorm,
    LeastTorque,
    Orientation,
    Posture,
    ProxQP,
    at_rate,
    gravity_compensation,
    minimum_jerk,
    support_polygon,
)
from condyn_pin.dynamics.solution import Sites
from condyn_pin.errors import UnsupportedBackend
from condyn_pin.mechanism import anchored, project_velocity, without
from condyn_pin.model import CoupledMotor

pytest.importorskip("proxsuite")
pytest.importorskip("daqp")
pytest.importorskip("quadprog")
pytest.importorskip("qpsolvers")

FEET = ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")
WEIGHT = 2.50000279 * 9.81  # of Solo12 [N]
STAND = (
    CenterOfMass(kp=20, weight=100),
    Orientation("base_link", weight=50),
    Posture("standing", weight=0.1),
)
OCTAGON = FrictionCone(0.6, sides=8)


@functools.cache
def solo() -> tuple[cp.Scene, np.ndarray, np.ndarray]:
    made = robot("solo12")
    scene = cp.Scene(made, made.contacts)
    return (scene, *scene.state())


@functools.cache
def cassie() -> tuple[cp.Scene, np.ndarray, np.ndarray]:
    made = cp.load_robot("cassie", variant={"feet": "lines", "springs": "locked"})
    scene = cp.Scene(made, [*made.loops, *made.contacts])
    return (scene, *scene.state())


@functools.cache
def talos() -> tuple[cp.Scene, np.ndarray, np.ndarray]:
    made = robot("talos")
    scene = cp.Scene(made, made.contacts)
    return (scene, *scene.state())


def tasks_of(base: str) -> tuple:
    return CenterOfMass(kp=20, weight=100), Orientation(base, weight=50), Posture(weight=0.1)


CASES = {
    "solo12": (solo, STAND, OCTAGON),
    "cassie": (cassie, tasks_of("pelvis"), WrenchCone(0.6)),
    "talos": (talos, tasks_of("base_link"), WrenchCone(0.5)),
}


def normal_forces(answer) -> np.ndarray:
    return np.array([force.in_world()[2] for force in answer.forces.values()])


def is_proved(answer) -> bool:
    """By a solve of the forward dynamics, which knows nothing of the program."""
    forward = cp.solve(answer.scene, answer.q, np.zeros(answer.scene.robot.nv), answer.tau)
    return np.abs(forward.a - answer.a).max() < 1e-7 * max(np.abs(answer.a).max(), 9.81)


# Known answers


def test_solo_stands_on_four_equal_forces():
    scene, q, v = solo()
    out = Controller(scene, STAND, cones=OCTAGON).solve(q, v)
    assert out.status.ok
    assert np.allclose(normal_forces(out), 6.131, atol=5e-4)
    assert np.allclose(normal_forces(out), WEIGHT / 4, atol=1e-6)
    assert out.residuals.kkt <= 1e-9
    assert out.residuals.dynamics <= 1e-11
    assert is_proved(out)


@pytest.mark.long
def test_without_a_foot_the_two_beside_it_carry_all():
    """The centre of mass is above the diagonal: 12.262, 12.262 and nothing."""
    scene, q, v = solo()
    four = Controller(scene, STAND, cones=OCTAGON)
    three = four.use(without(scene, ["FL_FOOT"]))
    out = three.solve(q, v)
    assert out.status.ok
    assert np.allclose(normal_forces(out), [12.262, 12.262, 0.0], atol=1e-3)
    assert all(margin.least > -1e-9 for margin in out.margins.values())


def test_above_the_centroid_of_three_feet_each_carries_a_third():
    scene, q, v = solo()
    model, feet = scene.robot.model, all_feet()
    centroid = np.mean(feet[1:], axis=0)
    for _ in range(20):  # the base moves, the legs follow, and the mass is elsewhere again
        q = q.copy()
        q[:2] += (centroid - com_of(model, q))[:2]
        q = legs_to(scene.robot, q, dict(zip(FEET, feet, strict=True)))
    assert np.abs((centroid - com_of(model, q))[:2]).max() < 1e-9
    stay = (CenterOfMass(reference=com_of(model, q), weight=100), STAND[1], Posture(q))
    four = Controller(scene, stay, cones=OCTAGON)
    out = four.use(without(scene, ["FL_FOOT"])).solve(q, v)
    assert out.status.ok
    assert np.allclose(normal_forces(out), 8.175, atol=5e-4)
    before = normal_forces(four.solve(q, v))  # the smallest forces on four
    assert before.sum() == pytest.approx(WEIGHT, abs=1e-3)
    assert np.allclose(np.array(feet)[:, :2].T @ before / WEIGHT, centroid[:2], atol=1e-5)


def all_feet() -> list[np.ndarray]:
    scene, q, v = solo()
    forces = cp.solve(scene, q, v, np.zeros(18)).forces
    return [forces[name].at for name in FEET]


def com_of(model, q: np.ndarray) -> np.ndarray:
    data = model.createData()  # what Pinocchio returns is in there
    return np.array(pin.centerOfMass(model, data, q))


def legs_to(made: cp.Robot, q: np.ndarray, feet: dict) -> np.ndarray:
    """Inverse kinematics of the legs, by Newton's method."""
    model = made.model
    data = model.createData()
    for _ in range(20):
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        rows, errors = [], []
        for name, wanted in feet.items():
            i = model.getFrameId(name)
            J = pin.getFrameJacobian(model, data, i, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
            rows.append(J[:3, 6:])
            errors.append(wanted - data.oMf[i].translation)
        step = np.linalg.solve(np.vstack(rows), np.concatenate(errors))
        q = pin.integrate(model, q, np.concatenate((np.zeros(6), step)))
    assert np.abs(np.concatenate(errors)).max() < 1e-12
    return q


def test_a_foot_is_lifted_and_the_others_carry_weight_and_thrust():
    scene, q, v = solo()
    four = Controller(scene, STAND, cones=OCTAGON)
    lift = FrameTask("FL_FOOT", a=(0, 0, 2.0), weight=50)
    out = four.use(without(scene, ["FL_FOOT"]), [*STAND, lift]).solve(q, v)
    assert out.status.ok
    thrust = scene.robot.mass * out.errors["CenterOfMass"][2]  # at rest it wants none
    assert normal_forces(out).sum() == pytest.approx(WEIGHT + thrust, rel=1e-6)
    assert np.abs(out.errors["FL_FOOT position"]).max() < 0.4


def test_cassies_program_is_small():
    """28 unknowns and 18 equations: with loops as rows it has 50 and 40."""
    scene, q, v = cassie()
    controller = Controller(scene, tasks_of("pelvis"), cones=WrenchCone(0.6))
    program = controller.program(q, v)
    assert program.A.shape == (18, 28)
    assert len(controller.rows) == len(program.C)
    assert np.linalg.matrix_rank(program.A) == 18
    out = controller.solve(q, v)
    assert out.status.ok
    assert np.abs(Sites(scene, q).jacobian[:12] @ out.a).max() < 1e-9
    assert is_proved(out)


@pytest.mark.long
@pytest.mark.parametrize("tolerance", [1e-9, 1e-6])
def test_a_program_of_cassie_that_has_an_answer_is_solved(tolerance):
    """With limp springs ProxQP calls it infeasible at 1e-9."""
    made = cp.load_robot("cassie", variant={"feet": "lines"})
    scene = cp.Scene(made, [*made.loops, *made.contacts])
    q, v = scene.state()
    out = Controller(
        scene, tasks_of("pelvis"), cones=WrenchCone(0.6), qp=ProxQP(tolerance=tolerance)
    ).solve(q, v)
    assert out.status.ok
    assert out.residuals.kkt <= 1e-9


@pytest.mark.long
@pytest.mark.parametrize("name", CASES)
def test_every_solver_gives_the_same_answer(name):
    made, tasks, cone = CASES[name]
    scene, q, v = made()
    answers = [Controller(scene, tasks, cones=cone, qp=kind()).solve(q, v) for kind in QPS.values()]
    assert all(out.status.ok for out in answers)
    size = np.abs(answers[0].tau).max()
    assert all(np.abs(out.tau - answers[0].tau).max() < 1e-6 * size for out in answers)


@pytest.mark.long
@pytest.mark.parametrize("name", CASES)
def test_random_states_are_answered_within_the_cones(name):
    made, tasks, cone = CASES[name]
    scene, _, _ = made()
    controller = Controller(scene, tasks, cones=cone)
    rng = np.random.default_rng(0)
    active = 0
    q0, _ = scene.state()
    for _ in range(15):
        # edges lie in the floor only where the robot stands
        q, v = scene.sample(rng, spread=0.02, speed=0.5)
        if name == "cassie":
            q, v = q0, project_velocity(scene, q0, v)
        out = controller.solve(q, v)
        assert out.status.ok
        assert out.residuals.kkt <= tolerances.KKT
        size = np.abs(out.lam).max()
        assert all(margin.least > -1e-8 * size for margin in out.margins.values())
        limit = np.array(scene.robot.model.effortLimit)[out.actuation.columns]
        assert (np.abs(out.tau[out.actuation.columns]) <= limit + 1e-7).all()
        active += bool(out.active)
    assert active or name == "cassie"


@pytest.mark.parametrize("name", ["cassie", "talos"])
def test_a_posture_weighted_with_inertia_is_gauss_principle(name):
    """min |a - a_free|_M, with motors everywhere, is the motion that none of them would change."""
    with own_task(nearest, "kg^1/2 m/s^2") as Nearest:
        scene, _, _ = CASES[name][0]()
        made, rng = scene.robot, np.random.default_rng(7)
        free = Controller(
            scene, [Nearest(weight=1e6)], cones={}, actuation=Actuation(made, made.joints),
            limits=ControlLimits(torque=False), regularisation=1e-9,
        )  # fmt: skip
        for _ in range(5):
            q, v = scene.sample(rng, spread=0.1)
            out = free.solve(q, v)
            least = cp.solve(scene, q, v, 0 * v, solver=cp.dynamics.GaussPrinciple()).a
            assert out.status.ok
            assert np.abs(out.a - least).max() < 1e-9 * np.abs(least).max()


@pytest.mark.long
def test_points_of_a_foot_that_turns_leave_a_program():
    """Cassie's feet are two points each: turning, these contradict each other along the edge."""
    made = robot("cassie")
    scene, loops = cp.Scene(made, [*made.loops, *made.contacts]), cp.Scene(made, made.loops)
    q, v = scene.state()
    springs = [spring.joint for spring in made.springs]
    controller = Controller(scene, tasks_of("pelvis"), cones=OCTAGON, rigid=springs)
    assert controller.solve(q, v).residuals.constraints < 1e-10
    v = project_velocity(loops, q, 0.3 * np.random.default_rng(3).normal(size=made.nv))
    out = controller.solve(q, v)
    assert out.status.ok
    assert out.residuals.kkt < 1e-9
    least = max(map(abs, cp.solve(scene, q, v, 0 * v, throw=False).rest.values()))
    assert 1e-2 < out.residuals.constraints < 2 * least


@pytest.mark.long
@each_row(
    "task",
    [
        FrameTask("panda_link8", reference=(0.4, 0.1, 0.5)),
        Orientation("panda_link8"),
        CenterOfMass(a=(0.0, 0.0, 1.0)),
        AngularMomentum(),
    ],
)
def test_without_constraints_a_tick_knows_nothing_of_the_answer_before(task):
    """The drift of what a task is about is that of the motion, not of the last accelerations."""
    scene = cp.Scene(robot("panda"))
    q, v = scene.state()
    v = 0.1 * np.arange(1.0, len(v) + 1)
    tasks = [task, Posture(weight=1e-3)]
    first = Controller(scene, tasks, cones={}).solve(q, v)
    used = Controller(scene, tasks, cones={})
    used.solve(q, 0 * v)
    for _ in range(3):
        assert np.allclose(used.solve(q, v).tau, first.tau, rtol=1e-9, atol=1e-9)


@pytest.mark.long
def test_springs_that_are_taken_for_rigid_do_not_accelerate():
    """What keeps them so is what they would have to give: at rest they give nothing."""
    free = robot("cassie")
    scene = cp.Scene(free, [*free.loops, *free.contacts])
    q, v = scene.state()
    springs = [spring.joint for spring in free.springs]
    stiff = Controller(scene, tasks_of("pelvis"), cones=OCTAGON, rigid=springs)
    out = stiff.solve(q, v, passive=free.passive_torque(q, v))
    assert out.status.ok
    places = [free.model.joints[free.model.getJointId(name)].idx_v for name in springs]
    assert np.abs(out.a[places]).max() < 1e-12
    assert not out.tau[places].any()
    assert (out.rigid > 20.0).all()
    locked = cp.load_robot("cassie", variant={"springs": "locked"})
    same = cp.Scene(locked, [*locked.loops, *locked.contacts])
    other = Controller(same, tasks_of("pelvis"), cones=OCTAGON).solve(*same.state())
    # of 39 N m; internal forces are as exact as a regularisation of 1e-5 leaves them
    assert np.allclose(out.u, other.u, atol=1e-4)
    bent = q.copy()
    bent[[free.model.joints[free.model.getJointId(name)].idx_q for name in springs]] = -0.03
    passive = free.passive_torque(bent, v)
    less = stiff.solve(q, v, passive=passive)
    assert np.allclose(less.rigid, out.rigid - passive[places], atol=1e-4)
    assert np.allclose(less.tau, out.tau, atol=1e-4)


# Contradictions


def test_to_pull_the_mass_down_faster_than_it_falls_is_refused_by_name():
    scene, q, v = solo()
    down = [CenterOfMass(a=(0, 0, -11.0), weight=np.inf), *STAND[1:]]
    out = Controller(scene, down, cones=OCTAGON).solve(q, v)
    assert out.status is ControlStatus.INFEASIBLE
    assert not out.status.ok
    assert np.isnan(out.tau).all()
    assert [each.row for each in out.infeasible.gives] == ["CenterOfMass.z"]
    assert out.infeasible.gives[0].amount == pytest.approx(11.0 - 9.81, abs=1e-6)
    assert out.infeasible.gives[0].unit == "m/s^2"
    assert {row.split(":")[0] for row in out.infeasible.against} == set(FEET)
    assert "CenterOfMass.z gives 1.19 m/s^2" in str(out)
    falls = [CenterOfMass(a=(0, 0, -9.0), weight=np.inf), *STAND[1:]]
    assert Controller(scene, falls, cones=OCTAGON).solve(q, v).status.ok


def test_a_foot_that_stands_cannot_be_lifted():
    scene, q, v = solo()
    lift = FrameTask("FL_FOOT", a=(0, 0, 2.0), weight=np.inf)
    out = Controller(scene, [*STAND, lift], cones=OCTAGON).solve(q, v)
    assert out.status is ControlStatus.INFEASIBLE
    (give,) = out.infeasible.gives
    assert (give.row, give.unit) == ("FL_FOOT position.z", "m/s^2")
    assert give.amount == pytest.approx(2.0, abs=1e-9)
    strict = Controller(scene, Hierarchy([*STAND, lift], [JointTask("FL_HAA")]), cones=OCTAGON)
    assert strict.solve(q, v).infeasible.gives == out.infeasible.gives


def test_limits_that_contradict_each_other_are_named():
    """A motor that is to move its joint faster than its own limit of acceleration."""
    scene, q, v = solo()
    limits, hard = ControlLimits(acceleration=10.0), JointTask("FL_HAA", a=15.0, weight=np.inf)
    controller = Controller(scene, STAND, cones=OCTAGON, limits=limits)
    assert controller.solve(q, v).status.ok
    out = controller.use(without(scene, ["FL_FOOT"]), [*STAND, hard]).solve(q, v)
    assert out.status is ControlStatus.INFEASIBLE
    assert "FL_HAA: acceleration" in str(out.infeasible)


# Limits


def slider(**limits: float) -> cp.Scene:
    """1 kg on a rail of 0.1 m to the right and 1 m to the left of its zero."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "x")
    model.appendBodyToJoint(joint, pin.Inertia.FromSphere(1.0, 0.05), pin.SE3.Identity())
    model.upperPositionLimit[:], model.lowerPositionLimit[:] = 0.1, -1.0
    for name, value in limits.items():
        setattr(model, name, np.array([value]))
    return cp.Scene(cp.Robot("slider", model, actuated=["x"]))


@pytest.mark.parametrize("goal", [1.0, -3.0])
@pytest.mark.parametrize(
    ("effort", "given"),
    [(0.0, {"dt": 0.05}), (5.0, {"dt": 0.002}), (5.0, {"dt": 0.02, "acceleration": 2.0})],
)
def test_a_joint_stops_at_its_end_and_never_behind(goal, effort, given):
    """Whatever the tick: v <= sqrt(2 A d) all along, and it comes to rest where its way ends."""
    scene = slider(effortLimit=effort)
    pull = [JointTask("x", reference=goal, kp=100.0)]
    controller = Controller(scene, pull, cones={}, limits=ControlLimits(**given))
    brake, end = min(given.get("acceleration", np.inf), effort or np.inf), 0.1 if goal > 0 else -1.0
    q, v, h = np.zeros(1), np.zeros(1), 2e-3
    for _ in range(900):
        out = controller.solve(q, v)
        assert out.status.ok
        assert not out.notices
        q, v = q + h * v + h**2 / 2 * out.a, v + h * out.a  # exact, a is held
        left = (end - q[0]) * np.sign(goal)
        assert left > -1e-12
        if np.isfinite(brake):
            assert v[0] * np.sign(goal) <= np.sqrt(2 * brake * max(left, 0.0)) + 1e-9
    assert abs(left) < 1e-4


@pytest.mark.parametrize(
    ("at", "speed", "a", "said"),
    [
        (0.2, 0.0, -5.0, "at 0.2 m and 0 m/s, beyond its upper limit 0.1 m"),
        (-1.001, 0.0, 0.8, "beyond its lower limit -1 m"),  # back within dt: 2 * 0.001 / dt^2
        (0.05, 1.0, -5.0, "too fast for its upper limit"),  # 0.1 m on the way to a stop
        (0.099, 0.05, -1.25, ""),  # v^2 / 2 d
        (-0.9, -1.5, 5.0, "too fast for its lower limit -1 m: the 5 m/s\\^2"),
        (-0.9, 2.5, -5.0, "moves at 2.5 .* beyond its limit of velocity 2"),
        (-0.5, 2.01, -0.2, "moves at 2.01 "),  # within dt
    ],
)
def test_beyond_its_limits_a_joint_returns_as_fast_as_it_may(at, speed, a, said):
    scene = slider(effortLimit=5.0, velocityLimit=2.0)
    way = JointTask("x", a=np.sign(speed or at) * 3.0)  # onwards
    controller = Controller(scene, [way], cones={}, limits=ControlLimits(dt=0.05))
    out = controller.solve([at], [speed])
    assert out.status.ok
    assert out.a[0] == pytest.approx(a, abs=1e-4)
    assert len(out.notices) == bool(said)
    assert re.search(said, "".join(out.notices))
    assert all(f"note: {notice}" in str(out) for notice in out.notices)


def test_motors_that_cannot_brake_a_joint_brake_it_as_well_as_they_can():
    """The load of the second link, thrown, is more than the first motor holds."""
    made = cp.model.chain(2)
    model = pin.Model(made.model)
    model.upperPositionLimit, model.lowerPositionLimit = np.full(2, 1.0), np.full(2, -9.0)
    model.velocityLimit, model.effortLimit = np.full(2, 100.0), np.array([1.0, 1e4])
    made = replace(made, model=model)
    throw = [JointTask(made.joints[1], a=0.0, weight=np.inf), Posture(np.full(2, 3.0))]
    controller = Controller(
        cp.Scene(made), throw, cones={}, actuation=Actuation(made, made.joints),
        limits=ControlLimits(dt=0.05),
    )  # fmt: skip
    out = controller.solve([0.99, 0.0], [3.0, 0.0])
    assert out.status.ok
    assert abs(out.tau[0]) == pytest.approx(1.0, abs=1e-2)
    assert any("brake" in notice for notice in out.notices)


def test_torque_limits_hold():
    scene, q, v = talos()
    jump = [CenterOfMass(a=(0, 0, 30.0), weight=100.0), *tasks_of("base_link")[1:]]
    out = Controller(scene, jump, cones=WrenchCone(0.5)).solve(q, v)
    limit = np.array(scene.robot.model.effortLimit)[out.actuation.columns]
    ratio = np.abs(out.tau[out.actuation.columns]) / limit
    assert out.status.ok
    assert ratio.max() == pytest.approx(1.0, abs=1e-9)
    assert any("torque at" in row for row in out.active)
    free = Controller(scene, jump, cones=WrenchCone(0.5), limits=ControlLimits(torque=False))
    assert np.abs(free.solve(q, v).tau[out.actuation.columns] / limit).max() > 1.1


def test_position_and_velocity_limits_hold_over_their_time():
    scene, q, v = talos()
    dt, model = 0.05, scene.robot.model
    knee = "leg_left_4_joint"
    wild = [*tasks_of("base_link"), JointTask(knee, a=-1e4, weight=1e3)]
    limits = ControlLimits(torque=False, dt=dt)
    out = Controller(without(scene, ["left_sole_link"]), wild, cones=WrenchCone(0.5), limits=limits)
    a = out.solve(q, v).a
    i = model.joints[model.getJointId(knee)]
    assert abs(v[i.idx_v] + dt * a[i.idx_v]) <= model.velocityLimit[i.idx_v] + 1e-9
    ahead = q[i.idx_q] + dt * v[i.idx_v] + dt**2 * a[i.idx_v] / 2
    assert ahead >= model.lowerPositionLimit[i.idx_q] - 1e-9
    most = ControlLimits(torque=False, acceleration=3.0)
    a = Controller(without(scene, ["left_sole_link"]), wild, cones=WrenchCone(0.5), limits=most)
    motors = Actuation(scene.robot).columns
    assert np.abs(a.solve(q, v).a[motors]).max() == pytest.approx(3.0, abs=1e-9)


# Tasks


def test_tasks_do_what_they_say():
    """Each alone, far from its reference: J a + drift is what the feedback wants."""
    scene, q, _ = talos()
    made, rng = scene.robot, np.random.default_rng(1)
    v = project_velocity(scene, q, 0.1 * rng.normal(size=made.nv))
    model = made.model
    data = model.createData()
    hand, cone = "gripper_left_base_link", WrenchCone(0.9)
    pin.forwardKinematics(model, data, q, v)
    pin.updateFramePlacements(model, data)
    place = data.oMf[model.getFrameId(hand)]
    turned = pin.SE3(place.rotation @ pin.exp3(np.array([0, 0, 0.1])), place.translation + 0.01)
    com = pin.centerOfMass(model, data, q)
    cases = [
        CapturePoint(reference=com + 0.01, k=0.5),
        CenterOfMass(reference=com + 0.01, kp=4.0),
        FrameTask(hand, reference=turned.translation, kp=4.0),
        FrameTask(hand, reference=turned, of="pose", kp=4.0),
        Orientation(hand, reference=turned.rotation, kp=4.0),
        JointTask("arm_left_4_joint", reference=-1.5, kp=4.0),
        AngularMomentum((0.1, 0.0, -0.1), k=2.0),
        ContactForce("left_sole_link", (0.0, 0.0, 500.0)),
    ]
    missing = set(TASKS) - {type(task).__name__ for task in cases} - {"Posture"}
    assert not missing, f"add an example of the task {missing} to `cases`"
    for task in cases:
        out = Controller(scene, [task], cones=cone, regularisation=1e-9).solve(q, v)
        assert out.status.ok
        (error,) = out.errors.values()
        assert np.abs(error).max() < 1e-3, task
        measured(task, scene, q, v, out, error)


@pytest.mark.long
def test_tasks_together_see_what_each_sees_alone():
    """They share the memory of one state, whatever their order."""
    scene, q, _ = talos()
    v = project_velocity(scene, q, 0.2 * np.random.default_rng(2).normal(size=scene.robot.nv))
    hand = "gripper_left_base_link"
    tasks = [
        AngularMomentum(), CenterOfMass(), Orientation(hand), FrameTask(hand, of="pose"),
        ContactForce("left_sole_link", weight=1e-4), Posture(weight=0.1),
    ]  # fmt: skip
    wanted = {}
    for task in tasks:
        one = Controller(scene, [task], cones=WrenchCone(0.5))
        program, (level,) = one._program.assemble(q, v, 0.0, np.zeros(scene.robot.nv))
        wanted[task.name] = level
    for order in (tasks, tasks[::-1]):
        every = Controller(scene, order, cones=WrenchCone(0.5))
        out = every.solve(q, v)
        assert out.status.ok
        x = np.linalg.lstsq(program.A, program.b)[0]  # any that the equations allow
        every._program.assemble(q, v, 0.0, np.zeros(scene.robot.nv))
        errors = every._program.errors(x)
        for name, level in wanted.items():
            assert np.abs(errors[name] - (level.rows.of(x) - level.rows.b)).max() < 1e-9


def measured(task, scene, q, v, out, error) -> None:
    """The rate of each quantity by differences along the motion that the answer makes."""
    model, h = scene.robot.model, 1e-5

    def at(t):
        moved = pin.integrate(model, q, t * v + t * t * out.a / 2)
        speed = v + t * out.a
        data = model.createData()
        pin.computeCentroidalMomentum(model, data, moved, speed)
        pin.forwardKinematics(model, data, moved, speed)
        pin.updateFramePlacements(model, data)
        pin.centerOfMass(model, data, moved, speed)
        return data

    if isinstance(task, CapturePoint):
        after, before, now = at(h), at(-h), at(0.0)
        rate = (after.vcom[0] - before.vcom[0]) / (2 * h)
        floor = now.oMf[model.getFrameId("left_sole_link")].translation[2]
        square = 9.81 / (task.reference[2] - floor)
        wanted = 0.5 * square * (np.array(task.reference) - now.com[0])
        wanted -= 1.5 * np.sqrt(square) * now.vcom[0]
        assert np.abs(rate - wanted - error).max() < 1e-6
    if isinstance(task, CenterOfMass):
        after, before, now = at(h), at(-h), at(0.0)
        rate = (after.vcom[0] - before.vcom[0]) / (2 * h)
        wanted = 4.0 * (np.array(task.reference) - now.com[0]) - 4.0 * now.vcom[0]
        assert np.abs(rate - wanted - error).max() < 1e-6
    if isinstance(task, AngularMomentum):
        after, before, now = at(h), at(-h), at(0.0)
        rate = (after.hg.angular - before.hg.angular) / (2 * h)
        wanted = 2.0 * (np.array(task.reference) - now.hg.angular)
        assert np.abs(rate - wanted - error).max() < 1e-6
    if isinstance(task, (FrameTask, Orientation)):
        i = model.getFrameId(task.frame)
        aligned = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        there = [at(t) for t in (h, -h, 0.0)]
        after, before, now = (pin.getFrameVelocity(model, d, i, aligned).vector for d in there)
        place, rate = there[2].oMf[i], (after - before) / (2 * h)
        if isinstance(task, Orientation):
            R = pin.Quaternion(np.array(task.reference)).matrix()
            wanted = 4.0 * pin.log3(R @ place.rotation.T) - 4.0 * now[3:]
            assert np.abs(rate[3:] - wanted - error).max() < 1e-5
        else:
            wanted = 4.0 * (np.array(task.reference)[:3] - place.translation) - 4.0 * now[:3]
            assert np.abs(rate[:3] - wanted - error[:3]).max() < 1e-5
    if isinstance(task, ContactForce):
        force = out.forces[task.contact].in_world()[:3]
        assert np.abs(force - task.reference - error).max() < 1e-9


def test_a_reference_may_be_a_function_of_time():
    scene, q, v = solo()
    model = scene.robot.model
    start = com_of(model, q)

    def sway(t):
        x = np.array([0.0, 0.01, 0.0])
        return start + x * np.sin(2 * t), 2 * x * np.cos(2 * t), -4 * x * np.sin(2 * t)

    tasks = [CenterOfMass(reference=sway, weight=1e3), Posture(weight=1e-3)]
    controller = Controller(scene, tasks, cones=OCTAGON)
    for t in (0.0, 0.3, 1.0):
        out = controller.solve(q, v, t)
        x, speed, a = sway(t)
        wanted = a + 100.0 * (x - start) + 20.0 * speed
        data = model.createData()
        jacobian = pin.jacobianCenterOfMass(model, data, q)
        assert np.allclose(jacobian @ out.a, wanted, atol=2e-3)


def test_one_joint_follows_numbers_and_paths():
    scene, q, v = solo()
    ways = (
        lambda t: (0.1, 0.2, 3.0),
        lambda t: (np.array([0.1]), np.array([0.2]), np.array([3.0])),
        minimum_jerk(0.1, 0.1, 1.0),
        minimum_jerk([0.1], [0.1], 1.0),
    )
    for way, wanted in zip(ways, (6.0, 6.0, 1.0, 1.0), strict=True):
        task = JointTask("FL_HAA", reference=way, kp=100.0, kd=10.0, weight=np.inf)
        out = Controller(scene, [task], cones=OCTAGON).solve(np.r_[q[:7], 0.09, q[8:]], v, 0.5)
        assert out.a[6] == pytest.approx(wanted, abs=1e-9), way


@pytest.mark.long
def test_one_joint_alone_moves_its_mass_and_turns():
    """A pendulum: its centre moves at l a, and L = I a; one column comes as a vector elsewhere."""
    hinge = body(pin.JointModelRY(), centre=(0.0, 0.0, -0.5), inertia=0.01)
    scene, motors = cp.Scene(hinge), Actuation(hinge, ["joint"])
    for task, a in (
        (CenterOfMass(a=(1.0, 0.0, 0.0)), -2.0),
        (AngularMomentum((0.0, 0.1, 0.0), k=10.0), 1.0 / 0.02),
    ):
        equations = replace(task, weight=np.inf)
        out = Controller(scene, [equations], cones={}, actuation=motors).solve([0.0], [0.0])
        assert out.status.ok
        assert out.a[0] == pytest.approx(a, abs=1e-12)


def test_a_reference_that_is_wrong_is_named_by_its_task():
    scene, q, v = solo()
    wrong = {
        "sway": CenterOfMass(reference=lambda t: (q[:2], q[:3], q[:3]), name="sway"),
        "rest": Posture(reference=lambda t: (q[:3], v, v), name="rest"),
        "turn": Orientation("base_link", reference=lambda t: (np.eye(2), 0, 0), name="turn"),
    }
    for name, task in wrong.items():
        with pytest.raises(cp.InvalidArgument, match=rf"{name}: reference\(0.3\).* needed"):
            Controller(scene, [task], cones=OCTAGON).solve(q, v, 0.3)


@pytest.mark.long
def test_contacts_that_may_open_are_not_left_out_in_silence():
    scene, q, v = solo()
    made = scene.robot
    floor = cp.Scene(made, contacts=made.frictional_contacts(friction=0.7))
    controller = Controller(scene, STAND, cones=OCTAGON)
    for wrong in (
        lambda: Controller(floor, STAND, cones=OCTAGON),
        lambda: controller.use(floor),
    ):
        with pytest.raises(
            cp.errors.UnsupportedConstraint, match=r"4 contacts may open.*scene\.closed"
        ):
            wrong()
    out = Controller(floor.closed(), STAND, cones=OCTAGON).solve(q, v)
    assert np.abs(out.tau - controller.solve(q, v).tau).max() < 1e-9


@pytest.mark.long
def test_a_minimum_jerk_way_is_smooth_and_at_rest_at_both_ends():
    start, end = np.array([0.1, -0.2, 0.9]), np.array([0.3, 0.1, 0.8])
    way = minimum_jerk(start, end, 0.5, begin=0.2)
    for t, place in ((0.0, start), (0.2, start), (0.7, end), (9.0, end)):
        x, v, a = way(t)
        assert np.allclose(x, place, atol=1e-15)
        assert max(np.abs(v).max(), np.abs(a).max()) < 1e-12
    x, v, a = way(0.45)
    assert np.allclose(x, (start + end) / 2)
    assert np.allclose(v, 15 / 8 * (end - start) / 0.5)  # the fastest there is
    assert np.abs(a).max() < 1e-12
    h = 1e-5
    for t in np.linspace(0.21, 0.69, 7):
        (before, v_before, _), (_, v, a), (after, v_after, _) = (way(t + s) for s in (-h, 0, h))
        assert np.allclose(v, (after - before) / (2 * h), atol=1e-8)
        assert np.allclose(a, (v_after - v_before) / (2 * h), atol=1e-7)
    assert pickle.loads(pickle.dumps(way)) == way
    for wrong in (
        lambda: minimum_jerk(start, end[:2], 0.5),
        lambda: minimum_jerk(start, end, 0.0),
        lambda: minimum_jerk(start, end * np.nan, 0.5),
    ):
        with pytest.raises(cp.InvalidArgument):
            wrong()


@pytest.mark.long
def test_a_task_of_ones_own_is_one_class():
    with own_task(still, "m/s^2") as Own:
        scene, q, v = solo()
        out = Controller(scene, [Own()], cones=OCTAGON).solve(q, v)
        assert np.abs(out.a).max() < 1e-5
        with pytest.raises(cp.InvalidArgument, match="a task named Own exists"):
            type("Own", (Own.__base__,), {"bind": lambda self, scene, home: None})


# Strict levels


def test_a_level_gives_nothing_to_those_below_it():
    """A push that friction cannot give: weights trade it, levels do not."""
    scene, q, v = talos()
    push = CenterOfMass(a=(6.0, 0.0, 0.0))
    rest = [Orientation("base_link"), Posture()]
    cone = WrenchCone(0.5)
    # a single level is weighed against the regularisation
    alone = Controller(scene, [push], cones=cone, regularisation=1e-8).solve(q, v)
    strict = Controller(scene, Hierarchy([push], rest[:1], rest[1:]), cones=cone).solve(q, v)
    weighted = Controller(scene, [push, *rest], cones=cone).solve(q, v)
    assert alone.status.ok and strict.status.ok and weighted.status.ok  # noqa: PT018
    best, first, traded = (
        np.linalg.norm(out.errors["CenterOfMass"]) for out in (alone, strict, weighted)
    )
    assert best > 0.1  # it cannot be had
    assert first == pytest.approx(best, rel=1e-8)
    assert traded > 1.05 * best
    assert all(margin.least > -1e-6 for margin in strict.margins.values())
    assert strict.residuals.dynamics < 1e-9
    assert is_proved(strict)


@each_row("weight", [1e-2, 1.0, 100.0])
def test_a_level_yields_nothing_to_the_regularisation(weight):
    """What levels can have, they have to 1e-8 m/s^2, at any weight; the rest is as small as can be.

    A third level, of forces, shares the load as it is told, as far as the first two leave it.
    """
    scene, q, v = solo()
    com = CenterOfMass(a=(1.0, 0.5, -1.0), weight=weight)
    level = Orientation("base_link", a=(0.3, -0.2, 0.1), weight=weight)
    out = Controller(scene, Hierarchy([com], [level]), cones=OCTAGON).solve(q, v)
    assert out.status.ok
    for error in out.errors.values():
        assert np.abs(error).max() < 1e-8
    small = Controller(
        scene, [replace(com, weight=1e7), replace(level, weight=1e7)], cones=OCTAGON,
        regularisation=1e-2,
    ).solve(q, v)  # fmt: skip
    assert np.abs(small.a - out.a).max() < 1e-5
    assert np.abs(small.lam - out.lam).max() < 1e-4 * WEIGHT


@pytest.mark.long
def test_rows_that_the_regularisation_alone_makes_active_are_left_to_lower_levels():
    """Least accelerations and forces unload a foot; the level below is to load it."""
    scene, q, v = solo()
    push = [CenterOfMass(a=(4.0, 0.0, 0.0), weight=1.0)]
    fixed = [Orientation("base_link", weight=1.0)]
    foot = ContactForce("FL_FOOT", (0.0, 0.0, 0.05 * WEIGHT), weight=1.0)
    levels = Hierarchy(push, fixed, [foot])
    out = Controller(scene, levels, cones=FrictionCone(0.6)).solve(q, v)
    assert out.status.ok
    assert np.abs(out.errors["CenterOfMass"]).max() < 1e-8
    ordered = zip(levels.levels, (1e6, 1e3, 1.0), strict=True)
    weighted = [replace(task, weight=weight) for (task,), weight in ordered]
    best = Controller(scene, weighted, cones=FrictionCone(0.6)).solve(q, v)
    missed = [np.abs(each.errors["FL_FOOT force"]).max() for each in (out, best)]
    assert missed[0] < missed[1] + 1e-3 * WEIGHT


def test_levels_that_end_in_a_corner_leave_what_they_have():
    """Pushes at random that the floor can give in part: little is left, and all of it proved."""
    scene, _, _ = talos()
    rng, rest = np.random.default_rng(5), [[Orientation("base_link")], [Posture()]]
    for _ in range(20):
        q, v = scene.sample(rng, spread=0.02, speed=0.5)
        push = CenterOfMass(a=4.0 * rng.normal(size=3), weight=100)
        out = Controller(scene, Hierarchy([push], *rest), cones=WrenchCone(0.5)).solve(q, v)
        alone = Controller(scene, Hierarchy([push]), cones=WrenchCone(0.5)).solve(q, v)
        assert out.status.ok
        assert alone.status.ok
        best, found = (np.linalg.norm(each.errors["CenterOfMass"]) for each in (alone, out))
        assert found <= best * (1 + 1e-4) + 1e-6
        size = np.abs(out.lam).max()
        assert all(margin.least > -1e-8 * size for margin in out.margins.values())


def test_levels_that_agree_are_all_done():
    scene, q, v = solo()
    out = Controller(scene, Hierarchy(*[[task] for task in STAND]), cones=OCTAGON).solve(q, v)
    assert out.status.ok
    assert all(np.abs(error).max() < 1e-4 for error in out.errors.values())
    assert np.allclose(normal_forces(out), WEIGHT / 4, atol=1e-3)


def test_a_level_that_is_decided_takes_nothing_from_those_below():
    """Feet and trunk decide the joints: what rounding leaves of their rows has any direction."""
    scene, q, v = solo()
    body, joints = STAND[:2], STAND[2:]
    wanted = ContactForce("FL_FOOT", (0.0, 0.0, 7.0))
    for levels in ((body, [wanted]), (body, joints, [wanted]), (joints, body, [wanted])):
        out = Controller(scene, Hierarchy(*levels), cones=OCTAGON).solve(q, v)
        assert out.status.ok
        assert np.abs(out.errors[wanted.name]).max() < 1e-4


@pytest.mark.long
def test_an_arm_without_contacts_has_levels_too():
    """Three hinges in a plane: the tip first, and what is left for the last joint."""
    arm = cp.model.chain(3)
    scene = cp.Scene(arm)
    q, v = np.array([0.3, 0.4, -0.5]), np.array([0.1, -0.2, 0.3])
    free = ControlLimits(torque=False)
    first = JointTask(arm.joints[0], a=1.0)
    both = Posture(q, joints=arm.joints, kp=4.0)
    motors = Actuation(arm, arm.joints)
    out = Controller(
        scene, Hierarchy([first], [both]), cones={}, limits=free, actuation=motors
    ).solve(q, v)
    assert out.status.ok
    assert out.margins == {}
    assert np.allclose(out.a, [1.0, *(-4.0 * v[1:])], atol=1e-3)
    assert np.abs(cp.solve(scene, q, v, out.tau).a - out.a).max() < 1e-9


# Switching, memory


def test_switching_back_and_forth_changes_no_answer():
    scene, q, v = solo()
    four = Controller(scene, STAND, cones=dict.fromkeys(FEET, OCTAGON))
    first = four.solve(q, v)
    three = four.use(without(scene, ["FL_FOOT"]))
    assert three is four.use(without(scene, ["FL_FOOT"]))
    assert three.use(scene) is four
    three.solve(q, v)
    again = four.solve(q, v)
    assert again.path == ("last active set",)
    assert np.abs(first.tau - again.tau).max() < 1e-12
    assert set(three.solve(q, v).margins) == set(FEET[1:])


@pytest.mark.long
def test_passive_torques_and_gears_count():
    scene, q, v = solo()
    passive = np.zeros(18)
    passive[6:] = 0.1
    plain = Controller(scene, STAND, cones=OCTAGON).solve(q, v)
    helped = Controller(scene, STAND, cones=OCTAGON).solve(q, v, passive=passive)
    assert helped.status.ok
    assert np.allclose(helped.tau + passive, plain.tau, atol=1e-6)
    geared = Actuation(scene.robot, ratios={"FL_KFE": 9.0})
    out = Controller(scene, STAND, cones=OCTAGON, actuation=geared).solve(q, v)
    assert np.allclose(out.tau, plain.tau, atol=1e-9)
    assert out.torques["FL_KFE"] == pytest.approx(plain.torques["FL_KFE"] / 9.0, abs=1e-9)


@pytest.mark.long
def test_motors_that_work_against_each_other_share():
    """A five-bar with motors at every joint: more motors than freedoms."""
    bar = cp.model.five_bar()
    scene = cp.Scene(bar, bar.loops)
    q, v = scene.state()
    every = Actuation(bar, bar.joints)
    out = Controller(
        scene, [Posture(joints=bar.joints)], cones={}, actuation=every,
        limits=ControlLimits(torque=False),
    ).solve(q, v)  # fmt: skip
    assert out.status.ok
    assert np.abs(out.a).max() < 1e-4
    assert is_proved(out)


# Motors on several joints


def each_by_itself(scene: cp.Scene, gear: float = 3.0) -> Actuation:
    """The motors of a robot, as motors of one joint each with a gear and the limit of the joint."""
    made = scene.robot
    most = [made.model.effortLimit[made.index_v(joint)] / gear for joint in made.actuated]
    return Actuation(made, [
        CoupledMotor(f"of {joint}", {joint: gear}, (-limit, limit))
        for joint, limit in zip(made.actuated, most, strict=True)
    ])  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("name", ["solo12", "talos", "cassie"])
def test_motors_of_one_joint_each_are_those_of_joints(name):
    """The same answer, where limits are active too.

    To a tenth of the regularisation, which alone decides what loops and feet leave open.
    """
    made = cp.load_robot(name, variant={"feet": "lines"}) if name == "cassie" else robot(name)
    scene = cp.Scene(made, [*made.loops, *made.contacts])
    q, v = scene.state()
    rigid = [spring.joint for spring in made.springs]
    weak = pin.Model(made.model)
    tasks = [CenterOfMass(a=(0, 0, 3.0), weight=100.0), Posture(weight=1.0)]
    chosen = {"cones": OCTAGON if name == "solo12" else WrenchCone(0.6), "rigid": rigid}
    torques = Controller(scene, tasks, **chosen).solve(q, v).tau
    weak.effortLimit = np.full(made.nv, 0.9 * np.abs(torques).max())
    scene = cp.Scene(replace(made, model=weak), scene.constraints)
    plain = Controller(scene, tasks, **chosen)
    coupled = Controller(scene, tasks, actuation=each_by_itself(scene), **chosen)
    a, b = plain.solve(q, v), coupled.solve(q, v)
    assert a.status.ok
    assert b.status.ok
    assert any("torque" in row for row in a.active)
    assert any("torque" in row for row in b.active)
    assert np.abs(a.tau - b.tau).max() < 1e-6 * np.abs(a.tau).max()
    assert np.abs(a.a - b.a).max() < 1e-6 * max(1.0, np.abs(a.a).max())
    assert np.abs(3.0 * b.u - a.u).max() < 1e-6 * np.abs(a.u).max()


def wrist(*limits: tuple[float, float]) -> tuple[cp.Scene, Actuation]:
    """Two hinges that cross without gravity, of inertia 1 and 0.5, moved by a differential."""
    model = pin.Model()
    model.gravity.linear = np.zeros(3)
    yaw = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "yaw")
    model.appendBodyToJoint(
        yaw, pin.Inertia(1.0, np.zeros(3), np.diag([0.5] * 3)), pin.SE3.Identity()
    )
    pitch = model.addJoint(yaw, pin.JointModelRY(), pin.SE3.Identity(), "pitch")
    model.appendBodyToJoint(
        pitch, pin.Inertia(1.0, np.zeros(3), np.diag([0.5] * 3)), pin.SE3.Identity()
    )
    signs = ((1.0, 1.0), (1.0, -1.0))
    made = cp.Robot("wrist", model).with_motors(*(
        CoupledMotor(name, dict(zip(("yaw", "pitch"), sign, strict=True)), limit)
        for name, sign, limit in zip(("left", "right"), signs, limits, strict=True)
    ))  # fmt: skip
    return cp.Scene(made), Actuation(made)


def test_a_differential_by_hand():
    """1 a_yaw = u_l + u_r, 0.5 a_pitch = u_l - u_r; where one motor ends, the other still acts."""
    scene, _ = wrist((-9.0, 9.0), (-9.0, 9.0))
    wish = [JointTask("yaw", a=4.0, weight=1.0), JointTask("pitch", a=2.0, weight=1.0)]
    out = Controller(scene, wish, cones={}, regularisation=1e-12).solve([0, 0], [0, 0])
    assert out.status.ok
    assert out.a == pytest.approx([4.0, 2.0], abs=1e-9)
    assert out.u == pytest.approx([2.5, 1.5], abs=1e-9)
    assert out.torques == pytest.approx({"left": 2.5, "right": 1.5})
    # u_l <= 1 leaves min (1 + r - 4)^2 + (2 (1 - r) - 2)^2: 2 (r - 3) + 8 r = 0
    scene, _ = wrist((-1.0, 1.0), (-9.0, 9.0))
    controller = Controller(scene, wish, cones={}, regularisation=1e-12)
    out = controller.solve([0, 0], [0, 0])
    assert controller.rows == ("left: torque", "right: torque")
    assert out.active == ("left: torque at upper",)
    assert out.u == pytest.approx([1.0, 0.6], abs=1e-6)
    assert out.a == pytest.approx([1.6, 0.8], abs=1e-6)


@pytest.mark.long
def test_the_limit_of_a_joint_counts_for_all_motors_that_act_on_it():
    scene, _ = wrist((-9.0, 9.0), (-9.0, 9.0))
    model = pin.Model(scene.robot.model)
    model.effortLimit = np.array([3.0, 0.0])  # that of the pitch is none
    scene = cp.Scene(replace(scene.robot, model=model))
    wish = [JointTask("yaw", a=4.0), JointTask("pitch", a=2.0)]
    out = Controller(scene, wish, cones={}, regularisation=1e-12).solve([0, 0], [0, 0])
    assert out.active == ("yaw: torque at upper",)
    assert out.tau == pytest.approx([3.0, 1.0], abs=1e-6)
    free = ControlLimits(torque=False)
    out = Controller(scene, wish, cones={}, limits=free).solve([0, 0], [0, 0])
    assert out.tau == pytest.approx([4.0, 1.0], abs=1e-3)


def finger(cables: dict[str, float], least: float = 0.0, most: float = 50.0) -> cp.Scene:
    """A hinge of inertia 0.5, moved by cables with lever arms."""
    scene, _ = wrist((-1.0, 1.0), (-1.0, 1.0))
    made = scene.lock(["yaw"], q=[0.0, 0.0]).robot
    limits = least, most
    return cp.Scene(made.with_motors(*(
        CoupledMotor(name, {"pitch": arm}, limits) for name, arm in cables.items()
    )))  # fmt: skip


def test_cables_only_pull_and_share_alike():
    """0.5 a = sum r_i u_i, u >= 0: the same torque by each that pulls, none by the others."""
    scene = finger({"flexor": 0.03, "deep": 0.04, "extensor": -0.02})
    for a, wanted in ((2.0, (50.0 / 3.0, 12.5, 0.0)), (-1.0, (0.0, 0.0, 25.0))):
        task = [JointTask("pitch", a=a, weight=1.0)]
        out = Controller(scene, task, cones={}, regularisation=1e-10).solve([0.0], [0.0])
        assert out.status.ok
        assert out.u == pytest.approx(wanted, abs=1e-4)
        assert out.tau == pytest.approx([0.5 * a], abs=1e-6)


@pytest.mark.long
def test_a_joint_brakes_with_what_its_cables_pull_against_it():
    """The flexor stops it in front of the lower limit, the extensor, half as strong, the upper."""
    scene = finger({"flexor": 0.02, "extensor": -0.01})  # 1 and 0.5 N m, 2 and 1 rad/s^2
    model = pin.Model(scene.robot.model)
    model.lowerPositionLimit, model.upperPositionLimit = np.array([-1.0]), np.array([1.0])
    scene = cp.Scene(replace(scene.robot, model=model))
    controller = Controller(
        scene, [JointTask("pitch", a=0.0)], cones={}, limits=ControlLimits(dt=1e-3)
    )
    for x, v, stops in ((0.8, 0.6, True), (0.8, 0.65, False), (-0.8, -0.85, True),
                        (-0.8, -0.95, False)):  # fmt: skip
        out = controller.solve([x], [v])
        assert (not any("do not stop it" in notice for notice in out.notices)) == stops, (x, v)


def test_motors_on_several_joints_are_left_to_python():
    scene, _ = wrist((-1.0, 1.0), (-1.0, 1.0))
    task = [JointTask("yaw", a=1.0)]
    with pytest.raises(UnsupportedBackend, match=r"act on several joints \(left, right\)"):
        Controller(scene, task, cones={}, engine="core")
    both = [
        Controller(scene, task, cones={}, engine=engine).solve([0, 0], [0, 0])
        for engine in ("python", "auto")
    ]
    assert np.array_equal(both[0].u, both[1].u)


@pytest.mark.long
def test_a_differential_drives_a_closed_loop():
    """The same accelerations as by the two motors of a five-bar, and their torques by hand."""
    bar = cp.model.five_bar()
    scene = cp.Scene(bar, bar.loops)
    q, _ = scene.sample(np.random.default_rng(0))
    v = np.zeros(bar.nv)
    pair = [
        CoupledMotor("sum", {"left_motor": 20.0, "right_motor": 20.0}),
        CoupledMotor("difference", {"left_motor": 1.0, "right_motor": -1.0}),
    ]
    wish = [JointTask("left_motor", a=3.0), JointTask("right_motor", a=-1.0)]
    plain, other = (
        Controller(scene, wish, cones={}, actuation=Actuation(bar, motors)).solve(q, v)
        for motors in (["left_motor", "right_motor"], pair)
    )
    assert is_proved(other)
    assert np.abs(other.a - plain.a).max() < 1e-7 * np.abs(plain.a).max()
    assert np.abs(other.tau - plain.tau).max() < 1e-7 * np.abs(plain.tau).max()
    left, right = plain.u
    assert other.u == pytest.approx([(left + right) / 40.0, (left - right) / 2.0], rel=1e-6)


@pytest.mark.long
def test_contacts_that_drifted_are_drawn_back():
    """J a + gamma = -2 alpha J v - beta^2 c, of a foot that is anchored 1 mm from where it is."""
    scene, q, v = solo()
    at = all_feet()[0] + np.array([0.0, 0.0, -1e-3])
    anchored = cp.Scene(
        scene.robot, [cp.PointContact("FL_FOOT", anchor=at), *scene.constraints[1:]]
    )
    drawn = Controller(anchored, STAND, cones=OCTAGON, drift=cp.Baumgarte(20.0, 20.0))
    out = drawn.solve(q, v)
    assert out.status.ok
    foot = Sites(scene, q).jacobian[:3] @ out.a
    R = out.forces["FL_FOOT"].rotation
    assert np.allclose(R @ foot, [0.0, 0.0, -0.4], atol=1e-9)


def test_anchored_feet_belong_where_they_stood():
    """Lifted by 1 mm they are drawn back, and without an anchor they stay where they are."""
    scene, q, v = solo()
    stood = anchored(scene, q)
    assert anchored(stood, q) is stood
    lifted = q.copy()
    lifted[2] += 1e-3
    gains = cp.Baumgarte(20.0, 20.0)
    for each, wanted in ((scene, 0.0), (stood, -0.4)):
        out = Controller(each, STAND, cones=OCTAGON, drift=gains).solve(lifted, v)
        assert out.status.ok
        feet = (Sites(each, lifted).jacobian @ out.a).reshape(-1, 3)
        for foot, force in zip(feet, out.forces.values(), strict=True):
            assert np.allclose(force.rotation @ foot, [0.0, 0.0, wanted], atol=1e-9)
    with pytest.raises(cp.InvalidArgument, match="q has shape"):
        anchored(scene, q[:5])


@pytest.mark.long
def test_a_contact_without_a_cone_is_held_like_a_loop():
    scene, q, v = solo()
    out = Controller(scene, STAND, cones=dict.fromkeys(FEET[1:], OCTAGON)).solve(q, v)
    assert out.status.ok
    assert set(out.margins) == set(FEET[1:])
    assert np.abs(Sites(scene, q).jacobian @ out.a).max() < 1e-9
    assert is_proved(out)


# Forces that are left to choose


@pytest.mark.parametrize("name", CASES)
def test_distributions_keep_the_motion_and_are_best_at_what_they_say(name):
    made, _, cone = CASES[name]
    scene, q, _ = made()
    plain = gravity_compensation(scene, q)
    kinds = (LeastNorm, LargestMargin, CentredPressure, LeastTorque)
    J = Sites(scene, q).jacobian
    answers = {kind: gravity_compensation(scene, q, distribution=kind(cone)) for kind in kinds}

    def margin(answer):
        return min(float(each.least) for each in margins(answer, cone).values())

    for answer in answers.values():
        whole = answer.tau + J.T @ answer.lam
        assert np.abs(whole - plain.tau - J.T @ plain.lam).max() < 1e-8
        assert margin(answer) > -1e-8
    norm = {kind: np.linalg.norm(answer.lam) for kind, answer in answers.items()}
    torque = {kind: np.linalg.norm(answer.u) for kind, answer in answers.items()}
    assert norm[LeastNorm] <= min(norm.values()) * (1 + 1e-6)
    assert torque[LeastTorque] <= min(torque.values()) * (1 + 1e-6)
    rows = {kind: least_slack(scene, q, answer, cone) for kind, answer in answers.items()}
    assert rows[LargestMargin] >= max(rows.values()) - 1e-3


def least_slack(scene, q, answer, cone) -> float:
    rows = cp.contact.cone_rows(scene, q, cone)
    return float(-(rows.A @ answer.lam).max())


@pytest.mark.parametrize("criterion", [LeastNorm, LeastTorque, LargestMargin, CentredPressure])
def test_a_mechanism_without_contacts_has_its_torques(criterion):
    bar = cp.model.four_bar()
    scene = cp.Scene(bar, bar.loops)
    q = scene.state()[0]
    out = gravity_compensation(scene, q, distribution=criterion({}))
    assert np.allclose(out.u, gravity_compensation(scene, q).u, atol=1e-12)


def test_feet_never_pull_and_what_the_floor_cannot_give_is_said():
    scene, q, _ = solo()
    three = without(scene, ["FL_FOOT"])
    pulls = gravity_compensation(three, q)
    assert min(float(m.least) for m in margins(pulls, OCTAGON).values()) < -0.1
    held = gravity_compensation(three, q, distribution=LeastTorque(OCTAGON))
    assert min(float(m.least) for m in margins(held, OCTAGON).values()) > -1e-8
    two = without(scene, ["FL_FOOT", "FR_FOOT"])  # those behind: it would tip
    with pytest.raises(cp.errors.Infeasible, match=r"the floor cannot give this motion: .*FOOT"):
        gravity_compensation(two, q, distribution=LeastNorm(OCTAGON))


# Bad input


def test_what_is_wrong_is_named():
    scene, q, v = solo()
    good = {"cones": OCTAGON}
    cases = [
        (lambda: Controller(scene, STAND[0], **good), "a list is needed"),
        (lambda: Controller(scene, [1], **good), "1 is no task"),
        (lambda: Controller(scene, [*STAND, STAND[0]], **good), "two are named 'CenterOfMass'"),
        (lambda: Controller(scene, STAND, cones=0.6), "FrictionCone or a WrenchCone is needed"),
        (lambda: Controller(scene, STAND, cones=WrenchCone(0.5)), "use FrictionCone"),
        (lambda: Controller(scene, STAND, qp="proxqp", **good), "qp = 'proxqp'"),
        (lambda: Controller(scene, STAND, limits=3, **good), "limits = 3"),
        (lambda: Controller(scene, STAND, regularisation=0.0, **good), "many solutions"),
        (lambda: Controller(scene.robot, STAND, **good), "scene = Robot: a Scene is needed"),
        (lambda: Controller(scene, STAND, drift=3, **good), "drift = 3: Baumgarte"),
        (
            lambda: Controller(scene, STAND, **good).use(cassie()[0]),
            "scene: cassie, .* make a Controller for it",
        ),
        (lambda: Controller(scene, STAND, rigid=["FL_KFE"], **good), "has a motor"),
        (lambda: Controller(scene, STAND, rigid="FL_KFE", **good), "a list of names is needed"),
        (lambda: at_rate(STAND, 1e-3), "a Controller is needed"),
        (lambda: at_rate(Controller(scene, STAND, **good), 0.0), "period = 0"),
        (lambda: at_rate(Controller(scene, STAND, **good), 1000), "rate in Hz the period is 1 /"),
        (
            lambda: cp.simulate(
                scene, *scene.state(), Controller(scene, STAND, **good), duration=1
            ),
            r"tau = Controller: .*control.at_rate\(controller, 1e-3\)",
        ),
        (
            lambda: cp.simulate(
                scene, *scene.state(), Controller(scene, STAND, **good).solve, duration=1
            ),
            r"tau takes \(q.*it is called with \(t, q, v\), in this order",
        ),
        (lambda: at_rate(Controller(scene, STAND, **good), 1e-3, watch=3), "watch"),
        (lambda: Controller(scene, STAND, **good).solve(q, v[:3]), "v has shape"),
        (lambda: Controller(scene, STAND, **good).solve(q, v, np.nan), "finite numbers"),
        (lambda: Controller(scene, STAND, **good).solve(q, v, passive=[1.0]), "passive"),
        (
            lambda: Controller(scene, STAND, **good).solve(q, v, passive=np.full(18, 1e308)),
            "passive .* overflows",
        ),
        (lambda: at_rate(Controller(scene, STAND, **good), 1e-3)(np.nan, q, v), "t = nan"),
        (lambda: at_rate(Controller(scene, STAND, **good), 1e-320)(1.0, q, v), "periods"),
        (lambda: gravity_compensation(scene, q, distribution="least"), "distribution = 'least'"),
        (lambda: CenterOfMass(weight=-1.0), "weight"),
        (lambda: CenterOfMass(weight=np.ones(3)), "weight has shape|one finite number"),
        (lambda: CenterOfMass(kp=-1.0), "kp"),
        (
            lambda: CenterOfMass(reference=(0, 0, 0), a=(0, 0, 0)),
            "an acceleration or a reference, not both",
        ),
        (
            lambda: Controller(scene, [CenterOfMass(reference=(0, 0))], **good).solve(q, v),
            "reference",
        ),
        (lambda: FrameTask("FL_FOOT", of="pase"), "position, pose"),
        (lambda: FrameTask("FL_FOOT", reference=(0, 0)), "reference"),
        (lambda: Controller(scene, [FrameTask("universe")], **good), "does not move"),
        (lambda: Orientation("base_link", reference=np.eye(3) * 2), "not a rotation"),
        (lambda: Controller(scene, [JointTask("root_joint")], **good), "degrees of freedom"),
        (lambda: ControlLimits(dt=-0.1), "dt = -0.1"),
        (lambda: ControlLimits(acceleration=0.0), "not positive"),
        (lambda: Hierarchy(), "none"),
        (lambda: Posture("standing", a=1.0), "JointTask"),
        (
            lambda: Posture("standing", reference=lambda t: None),
            "a function of t, without a posture",
        ),
    ]
    for wrong, words in cases:
        with pytest.raises(cp.InvalidArgument, match=words):
            wrong()
    held = dict.fromkeys(FEET[1:], OCTAGON)
    with pytest.raises(cp.InvalidArgument, match=r"FL_FOOT force is about .* no cone"):
        Controller(scene, [ContactForce("FL_FOOT")], cones=held).solve(q, v)
    for wrong in (
        lambda: Controller(scene, STAND, cones={"FL_FOT": OCTAGON}),
        lambda: Controller(scene, [Posture("standin")], **good),
        lambda: Controller(scene, [FrameTask("FL_FOT")], **good),
        lambda: Controller(scene, [ContactForce("FL_FOT")], **good),
        lambda: Controller(scene, [JointTask("FL_KF")], **good),
    ):
        with pytest.raises(cp.errors.UnknownName):
            wrong()


@pytest.mark.long
def test_tasks_that_are_read_once_are_all_done():
    scene, q, v = solo()
    once = Controller(scene, (task for task in STAND), cones=OCTAGON)
    assert once.tasks == STAND
    out = once.solve(q, v)
    assert set(out.errors) == {task.name for task in STAND}
    assert np.allclose(out.tau, Controller(scene, STAND, cones=OCTAGON).solve(q, v).tau, atol=1e-9)


def test_values_compare_hash_and_pickle():
    values = [*STAND, FrameTask("FL_FOOT", a=(0, 0, 2.0)), ControlLimits(dt=0.1), ProxQP(), DAQP()]
    values += [LargestMargin(OCTAGON), ContactForce("FL_FOOT", (0, 0, 1)), JointTask("FL_KFE")]
    scene, q, v = solo()
    controller = Controller(scene, STAND, cones=OCTAGON)
    copy = pickle.loads(pickle.dumps(controller))
    assert np.abs(copy.solve(q, v).tau - controller.solve(q, v).tau).max() < 1e-12
    for value in values:
        again = pickle.loads(pickle.dumps(value))
        assert again == value
        assert hash(again) == hash(value)
    assert Hierarchy(STAND) == Hierarchy(list(STAND)) != Hierarchy(STAND[:1])


def test_overflow_is_refused_and_nan_never_ok():
    scene, q, v = solo()
    controller = Controller(scene, STAND, cones=OCTAGON)
    with pytest.raises(cp.InvalidArgument, match="overflows"):
        controller.solve(q, v + 1e200)
    assert support_polygon(scene, q).margin([0.0, 0.0, 0.0]) > 0.1
