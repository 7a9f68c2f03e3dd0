"""The memory of a control tick: what it keeps is the same, and what it hands out stays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from own_task import own_task
from shared import each_row, robot

import condyn_pin as cp
from condyn_pin.contact import FrictionCone, WrenchCone
from condyn_pin.control import (
    Actuation,
    AngularMomentum,
    CenterOfMass,
    Controller,
    ControlLimits,
    ControlStatus,
    JointTask,
    Orientation,
    Posture,
)
from condyn_pin.mechanism import project_velocity

STAND = [CenterOfMass(kp=20, weight=100), Orientation("base_link", weight=50), Posture(weight=0.1)]


def moving(name: str) -> tuple[cp.Scene, list[tuple[np.ndarray, np.ndarray]]]:
    """A scene on its feet, and two states of it that move."""
    made = robot(name)
    scene = cp.Scene(made, made.contacts)
    q, _ = scene.state()
    rng = np.random.default_rng(1)
    speeds = [project_velocity(scene, q, 0.2 * rng.normal(size=made.nv)) for _ in range(2)]
    return scene, [(q, v) for v in speeds]


def cassie() -> tuple[cp.Scene, list[tuple[np.ndarray, np.ndarray]]]:
    """Cassie, whose loops are eliminated anew in each state."""
    made = cp.load_robot("cassie", variant={"feet": "lines", "springs": "locked"})
    scene = cp.Scene(made, [*made.loops, *made.contacts])
    q, v = scene.state()
    return scene, [(q, v), (q, project_velocity(scene, q, np.full(made.nv, 0.05)))]


@pytest.mark.parametrize("name", ["talos", "solo12"])
def test_a_program_and_an_answer_stay_as_they_were(name: str) -> None:
    scene, (first, second) = moving(name)
    cones = WrenchCone(0.5) if name == "talos" else FrictionCone(0.6, sides=8)
    controller = Controller(scene, STAND, cones=cones, limits=ControlLimits(dt=0.02))
    program, out = controller.program(*first), controller.solve(*first)
    parts = [*vars(program).values(), out.tau, out.a, out.lam, *out.errors.values()]
    before = [part.copy() for part in parts]
    assert np.abs(controller.program(*second).b - program.b).max() > 1e-3
    assert np.abs(controller.solve(*second).tau - out.tau).max() > 1e-3
    for part, then in zip(parts, before, strict=True):
        assert np.array_equal(part, then)


@pytest.mark.long
@pytest.mark.parametrize("name", ["talos", "solo12", "cassie"])
def test_what_is_computed_once_is_what_each_tick_would_compute(name: str) -> None:
    scene, states = cassie() if name == "cassie" else moving(name)
    base = "pelvis" if name == "cassie" else "base_link"
    posture = Posture(weight=0.1, kp=30.0, name="Own")
    bound = posture.bind(scene, lambda: states[0][0])
    others = [CenterOfMass(weight=100), Orientation(base, weight=50)]
    cones = FrictionCone(0.6, sides=8) if name == "solo12" else WrenchCone(0.5)

    def anew(motion, t):
        J, b = bound.rows(motion, t)
        full, wanted = np.zeros((scene.robot.nv, scene.robot.nv)), np.zeros(scene.robot.nv)
        full[: len(J)], wanted[: len(b)] = J, b  # other rows ask for nothing
        return full, wanted

    with own_task(anew, "rad/s^2") as Own:
        fresh = Controller(scene, [*others, Own(weight=0.1)], cones=cones)
    kept = Controller(scene, [*others, posture], cones=cones)
    first = Controller(scene, [posture, *others], cones=cones)
    for state in states:
        wanted = fresh.program(*state)
        for controller in (kept, first):
            found = controller.program(*state)
            assert np.abs(found.H - wanted.H).max() < 1e-12 * np.abs(wanted.H).max()
            assert np.abs(found.g - wanted.g).max() < 1e-12 * np.abs(wanted.g).max()
            assert np.array_equal(found.A, wanted.A)
            assert np.array_equal(found.C, wanted.C)


@each_row(
    ("rows", "found"),
    [
        (lambda motion, t: (np.ones((1, len(motion.v))), np.zeros(len(motion.v))), r"\(1, 18\)"),
        (lambda motion, t: (np.eye(len(motion.v)), np.zeros(1)), r"and \(1,\)"),
        (lambda motion, t: (np.eye(len(motion.v)), 0.0), r"and \(\)"),
    ],
)
def test_rows_of_another_shape_are_refused_by_name(rows, found: str) -> None:
    scene, (state, _) = moving("solo12")
    with own_task(rows, "m/s^2") as Own:
        controller = Controller(scene, [Own(name="still")], cones=FrictionCone(0.6))
        with pytest.raises(cp.InvalidArgument, match=rf"still has rows J and b.*{found}.*18"):
            controller.solve(*state)


def test_rows_may_be_lists() -> None:
    scene, (state, _) = moving("solo12")

    def lists(motion, t):
        return np.eye(len(motion.v)).tolist(), (-motion.v).tolist()

    with own_task(lists, "m/s^2") as Own:
        out = Controller(scene, [Own()], cones=FrictionCone(0.6)).solve(*state)
    assert out.status.ok


@pytest.mark.parametrize(("name", "weight", "speed"), [("talos", 1e2, 0.05), ("solo12", 1e4, 0.3)])
def test_forces_do_not_depend_on_the_tick_before(name, weight, speed, engine) -> None:
    """Regularisation alone shares them out: a KKT residual of 1e-10 may hide 0.1 of the weight."""
    made = robot(name)
    scene = cp.Scene(made, made.contacts)
    q, _ = scene.state()
    second = {"talos": AngularMomentum, "solo12": lambda **w: Orientation("base_link", **w)}[name]
    tasks = [CenterOfMass(kp=20, weight=weight), second(weight=weight), Posture(weight=0.1)]
    cones = WrenchCone(0.5) if name == "talos" else FrictionCone(0.6, sides=8)
    rng, changed, before = np.random.default_rng(0), 0, ()
    warm = Controller(scene, tasks, cones=cones, engine=engine.name)
    for _ in range(25):
        v = project_velocity(scene, q, speed * rng.normal(size=made.nv))
        out, fresh = warm.solve(q, v), Controller(scene, tasks, cones=cones).solve(q, v)
        assert out.status.ok
        assert np.abs(out.lam - fresh.lam).max() < 1e-6 * made.mass * 9.81
        changed += out.active != before
        before = out.active
    assert changed > 2


@pytest.mark.long
def test_limits_that_contradict_each_other_are_told_behind_a_tick_at_one_of_them(engine) -> None:
    """A joint at its largest acceleration, and then a task that is an equation and wants more."""
    made = cp.model.chain(2)
    model = pin.Model(made.model)
    for side, place in (("upper", 1.0), ("lower", -1.0)):
        setattr(model, f"{side}PositionLimit", np.full(2, place))
    model.velocityLimit, model.effortLimit = np.full(2, 100.0), np.full(2, 1e4)
    made = replace(made, model=model)
    away = Posture(np.array([3.0, 0.0]), kp=1000.0)
    jump = JointTask(made.joints[0], reference=lambda t: (0.0, 0.0, 40.0 + t), weight=np.inf)
    controller = Controller(
        cp.Scene(made), [away, jump], cones={}, actuation=Actuation(made, made.joints),
        limits=ControlLimits(dt=0.05, acceleration=50.0),
        engine="auto" if engine.native else "python",
    )  # fmt: skip
    q, v = np.zeros(2), np.zeros(2)
    assert controller.solve(q, v).a[0] == pytest.approx(40.0)
    out = controller.solve(q, v, 60.0)
    assert out.status is ControlStatus.INFEASIBLE
    assert made.joints[0] in str(out.infeasible)
