"""Mistakes in control: each is an error of its class that names what was wrong, never an answer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from shared import each_row, robot

import condyn_pin as cp
from condyn_pin.contact import FrictionCone, WrenchCone
from condyn_pin.control import (
    DAQP,
    Actuation,
    AngularMomentum,
    AnyQP,
    CapturePoint,
    CenterOfMass,
    ContactForce,
    Controller,
    ControlLimits,
    FrameTask,
    Hierarchy,
    JointTask,
    LargestMargin,
    LeastNorm,
    Orientation,
    Posture,
    ProxQP,
    PushBound,
    at_rate,
    balance,
    gravity_compensation,
    inverse_dynamics,
    minimum_jerk,
    operational_space,
    push_bound,
    support_polygon,
)
from condyn_pin.errors import CondynError, InvalidArgument, UnknownName, UnsupportedConstraint
from condyn_pin.mechanism import without

pytest.importorskip("proxsuite")

NAN, INF = float("nan"), float("inf")
CONE = FrictionCone(0.6)
SOLO = robot("solo12")
SCENE = cp.Scene(SOLO, SOLO.contacts)
Q, V = SCENE.state()
STAND = (CenterOfMass(weight=100), Orientation("base_link", weight=50), Posture(weight=0.1))
Mistake = tuple[Callable[[], Any], type[CondynError], str]


@cache
def bound(size: float = 1.0) -> PushBound:
    """Return what it stands to the front, along a way of some length."""
    return push_bound(SCENE, Q, (size, 0, 0), cones=CONE)


def solved(*tasks: Any, q: Any = Q, v: Any = V, t: Any = 0.0, **more: Any) -> Any:
    """Return the answer of a controller that stands with some more tasks."""
    passive = more.pop("passive", None)
    scene = more.pop("scene", SCENE)
    chosen = more.pop("tasks", [*STAND, *tasks])
    controller = Controller(scene, chosen, cones=more.pop("cones", CONE), **more)
    return controller.solve(q, v, t, passive=passive)


def at(path: Callable[[float], Any]) -> Any:
    """Return the answer to a reference that is a function."""
    return solved(tasks=[CenterOfMass(reference=path)])


def with_entry(x: Any, value: float) -> Any:
    changed = np.array(x, dtype=float)
    changed[-1] = value
    return changed


def weaker(torque: float) -> cp.Scene:
    model = SOLO.model.copy()
    model.effortLimit[6:] = torque
    return cp.Scene(replace(SOLO, model=model), SOLO.contacts)


def crossed() -> cp.Scene:
    model = SOLO.model.copy()
    lower = model.lowerPositionLimit.copy()
    lower[-1], upper = 1.0, model.upperPositionLimit.copy()
    upper[-1] = -1.0
    model.lowerPositionLimit, model.upperPositionLimit = lower, upper
    return cp.Scene(replace(SOLO, model=model), SOLO.contacts)


TASKS: dict[str, Mistake] = {
    "weight negative": (lambda: CenterOfMass(weight=-1), InvalidArgument, "weight = -1"),
    "weight nan": (lambda: Posture(weight=NAN), InvalidArgument, "weight = nan"),
    "weight a text": (lambda: Posture(weight="1"), InvalidArgument, "weight = '1'"),
    "weight minus infinity": (lambda: Posture(weight=-INF), InvalidArgument, "weight = -inf"),
    "weight True": (lambda: Posture(weight=True), InvalidArgument, "weight = True"),
    "name no text": (lambda: Posture(name=3), InvalidArgument, "name = 3"),
    "kp negative": (lambda: CenterOfMass(kp=-1), InvalidArgument, "kp = -1"),
    "kp nan": (lambda: CenterOfMass(kp=NAN), InvalidArgument, "kp = nan"),
    "kp infinite": (lambda: CenterOfMass(kp=INF), InvalidArgument, "kp = inf"),
    "kd negative": (lambda: Orientation("base_link", kd=-3), InvalidArgument, "kd = -3"),
    "k negative": (lambda: AngularMomentum(k=-1), InvalidArgument, "k = -1"),
    "k of a capture point": (lambda: CapturePoint(k=-1), InvalidArgument, "k = -1"),
    "beyond negative": (lambda: CapturePoint(beyond=-0.1), InvalidArgument, "beyond = -0.1"),
    "capture point of two": (lambda: CapturePoint(reference=(0, 0)), InvalidArgument, "reference"),
    "capture point beside the feet": (
        lambda: solved(CapturePoint(reference=(0.3, 0, 0.2))),
        InvalidArgument,
        "CapturePoint: reference = .* is not above the support",
    ),
    "com of two numbers": (lambda: CenterOfMass(reference=(0, 0)), InvalidArgument, "reference"),
    "com nan": (lambda: CenterOfMass(reference=(0, 0, NAN)), InvalidArgument, "reference"),
    "axes no names": (lambda: CenterOfMass(axes=3), InvalidArgument, "axes = 3: names of rows"),
    "com a text": (lambda: CenterOfMass(reference="up"), InvalidArgument, "reference"),
    "a and reference": (
        lambda: CenterOfMass(a=(0, 0, 0), reference=(0, 0, 1)),
        InvalidArgument,
        "a: give",
    ),
    "a of two numbers": (
        lambda: solved(tasks=[CenterOfMass(a=(0, 1))]),
        InvalidArgument,
        r"CenterOfMass\.a has shape \(2,\): an array of shape \(3,\) is needed$",
    ),
    "a nan": (lambda: CenterOfMass(a=(0, NAN, 0)), InvalidArgument, "a.1. = nan"),
    "frame unknown": (lambda: solved(FrameTask("FL_FOT")), UnknownName, "FL_FOOT"),
    "frame of the world": (lambda: solved(FrameTask("universe")), InvalidArgument, "universe"),
    "frame no text": (lambda: FrameTask(3), InvalidArgument, "frame = 3"),
    "of unknown": (lambda: FrameTask("FL_FOOT", of="place"), InvalidArgument, "of = 'place'"),
    "pose of three numbers": (
        lambda: FrameTask("FL_FOOT", of="pose", reference=(0, 0, 1)),
        InvalidArgument,
        "reference",
    ),
    "no rotation": (
        lambda: Orientation("base_link", reference=2 * np.eye(3)),
        InvalidArgument,
        "no. a rotation",
    ),
    "orientation of three numbers": (
        lambda: Orientation("base_link", reference=(0, 0, 1)),
        InvalidArgument,
        "reference",
    ),
    "joint unknown": (lambda: solved(JointTask("FL_KNEE")), UnknownName, "FL_KFE"),
    "joint of six": (lambda: solved(JointTask("root_joint")), InvalidArgument, "6 degrees"),
    "joint of two numbers": (
        lambda: JointTask("FL_KFE", reference=(0, 1)),
        InvalidArgument,
        "reference",
    ),
    "joint nan": (lambda: JointTask("FL_KFE", reference=NAN), InvalidArgument, "reference"),
    "posture unknown": (lambda: solved(tasks=[Posture("sitting")]), UnknownName, "sitting"),
    "posture short": (lambda: solved(tasks=[Posture(Q[:-1])]), InvalidArgument, "posture"),
    "posture nan": (lambda: Posture(with_entry(Q, NAN)), InvalidArgument, "posture"),
    "posture with a": (lambda: Posture(a=(1.0,)), InvalidArgument, "a: a posture"),
    "posture and reference": (
        lambda: Posture(Q, reference=lambda t: Q),
        InvalidArgument,
        "reference",
    ),
    "posture of no joint": (lambda: solved(tasks=[Posture(joints=[])]), InvalidArgument, "joints"),
    "posture of unknown joint": (
        lambda: solved(tasks=[Posture(joints=["FL_KNEE"])]),
        UnknownName,
        "FL_KFE",
    ),
    "contact unknown": (lambda: solved(ContactForce("FL")), UnknownName, "FL_FOOT"),
    "contact force of two": (
        lambda: ContactForce("FL_FOOT", (0, 1)),
        InvalidArgument,
        "reference has shape",
    ),
    "contact force nan": (lambda: ContactForce("FL_FOOT", (0, 0, NAN)), InvalidArgument, "refer"),
    "momentum of two": (lambda: AngularMomentum((0, 0)), InvalidArgument, "reference has shape"),
    "path of no argument": (
        lambda: CenterOfMass(reference=lambda: 0),
        InvalidArgument,
        "reference",
    ),
    "path that returns x alone": (
        lambda: at(lambda t: np.zeros(3)),
        InvalidArgument,
        r"reference\(0\).*\(x, v, a\)",
    ),
    "path of wrong length": (
        lambda: at(lambda t: (np.zeros(3), np.zeros(2), np.zeros(3))),
        InvalidArgument,
        "reference",
    ),
    "path with a of one number": (
        lambda: at(lambda t: ((0, 0, 0), (0, 0, 0), 0)),
        InvalidArgument,
        r"reference\(0\): a has shape \(1,\)",
    ),
    "path that is nan": (
        lambda: at(lambda t: (np.zeros(3), np.full(3, NAN), np.zeros(3))),
        InvalidArgument,
        "refe",
    ),
    "path of nothing": (lambda: at(lambda t: None), InvalidArgument, r"reference\(0\)"),
    "contact force path nan": (
        lambda: solved(ContactForce("FL_FOOT", lambda t: (0, 0, NAN))),
        InvalidArgument,
        "FL_FOOT",
    ),
}

CONTROLLER: dict[str, Mistake] = {
    "no scene": (lambda: Controller(SOLO, STAND, cones=CONE), InvalidArgument, "scene"),
    "no tasks": (lambda: solved(tasks=[]), InvalidArgument, "tasks"),
    "one task": (lambda: solved(tasks=Posture()), InvalidArgument, "a list is needed"),
    "no task among tasks": (lambda: solved(3), InvalidArgument, "3 is no task"),
    "tasks by class": (lambda: solved(Posture), InvalidArgument, "is no task"),
    "task twice": (lambda: solved(CenterOfMass()), InvalidArgument, "two are named 'CenterOfMass'"),
    "no level": (lambda: Hierarchy(), InvalidArgument, "levels: none"),
    "level empty": (lambda: Hierarchy([CenterOfMass()], []), InvalidArgument, "tasks"),
    "level no list": (lambda: Hierarchy(CenterOfMass()), InvalidArgument, "a list is needed"),
    "levels share a name": (
        lambda: solved(tasks=Hierarchy([Posture()], [Posture()])),
        InvalidArgument,
        "two are named",
    ),
    "cone a number": (lambda: solved(cones=0.6), InvalidArgument, "FrictionCone or a WrenchCone"),
    "cones none": (lambda: solved(cones=None), InvalidArgument, "cones"),
    "cone of unknown contact": (lambda: solved(cones={"FL": CONE}), UnknownName, "FL_FOOT"),
    "wrench cone on a point": (lambda: solved(cones=WrenchCone(0.6)), InvalidArgument, "FL_FOOT"),
    "friction negative": (lambda: FrictionCone(-0.1), InvalidArgument, "friction = -0.1"),
    "friction nan": (lambda: FrictionCone(NAN), InvalidArgument, "friction"),
    "cone of two sides": (lambda: FrictionCone(0.6, sides=2), InvalidArgument, "sides = 2"),
    "pyramid unknown": (lambda: FrictionCone(0.6, pyramid="in"), InvalidArgument, "pyramid = 'in'"),
    "contact twice": (
        lambda: cp.Scene(SOLO, [*SOLO.contacts, SOLO.contacts[0]]),
        CondynError,
        "FL_FOOT",
    ),
    "contacts may open": (
        lambda: solved(scene=cp.Scene(SOLO, contacts=SOLO.frictional_contacts(0.7))),
        UnsupportedConstraint,
        "may open",
    ),
    "solver by name": (lambda: solved(qp="ProxQP"), InvalidArgument, "qp = 'ProxQP'"),
    "solver by class": (lambda: solved(qp=ProxQP), InvalidArgument, "qp = "),
    "solver unknown": (lambda: solved(qp=AnyQP("osqq")), CondynError, "osqq"),
    "tolerance negative": (lambda: ProxQP(tolerance=-1), InvalidArgument, "tolerance = -1"),
    "iterations none": (lambda: DAQP(max_iterations=0), InvalidArgument, "max_iterations = 0"),
    "limits a number": (lambda: solved(limits=3), InvalidArgument, "limits = 3"),
    "limits by class": (lambda: solved(limits=ControlLimits), InvalidArgument, "limits = "),
    "dt zero": (lambda: ControlLimits(dt=0), InvalidArgument, "dt = 0"),
    "dt negative": (lambda: ControlLimits(dt=-1e-3), InvalidArgument, "dt = -0.001"),
    "dt nan": (lambda: ControlLimits(dt=NAN), InvalidArgument, "dt = nan"),
    "torque limit a number": (lambda: ControlLimits(torque=2.7), InvalidArgument, "torque = 2.7"),
    "acceleration zero": (lambda: ControlLimits(acceleration=0), InvalidArgument, "acceleration"),
    "acceleration nan": (lambda: ControlLimits(acceleration=NAN), InvalidArgument, "acceleration"),
    "acceleration short": (
        lambda: solved(limits=ControlLimits(acceleration=np.ones(5))),
        InvalidArgument,
        "(18,)",
    ),
    "position limits cross": (
        lambda: solved(scene=crossed(), limits=ControlLimits(dt=0.01)),
        InvalidArgument,
        "HR_KFE",
    ),
    "regularisation zero": (lambda: solved(regularisation=0), InvalidArgument, "regularisation"),
    "regularisation nan": (lambda: solved(regularisation=NAN), InvalidArgument, "regularisation"),
    "drift a number": (lambda: solved(drift=10.0), InvalidArgument, "drift = 10"),
    "rigid unknown": (lambda: solved(rigid=["FL_KNEE"]), UnknownName, "FL_KFE"),
    "rigid with motor": (lambda: solved(rigid=["FL_KFE"]), InvalidArgument, "has a motor"),
    "rigid a text": (lambda: solved(rigid="FL_KFE"), InvalidArgument, "rigid"),
    "motors of another robot": (
        lambda: solved(actuation=Actuation(robot("go2"))),
        InvalidArgument,
        "actuation",
    ),
    "motors a list": (lambda: solved(actuation=["FL_KFE"]), InvalidArgument, "actuation = "),
    "motor unknown": (lambda: Actuation(SOLO, ["FL_KNEE"]), UnknownName, "FL_KFE"),
    "gear of zero": (lambda: Actuation(SOLO, ["FL_KFE"], [0]), InvalidArgument, "FL_KFE' is 0"),
    "no motor": (lambda: Actuation(SOLO, []), InvalidArgument, "no joint with a motor"),
    "q short": (lambda: solved(q=Q[:-1]), InvalidArgument, "q has shape"),
    "q nan": (lambda: solved(q=with_entry(Q, NAN)), InvalidArgument, "q"),
    "q not normalised": (lambda: solved(q=2 * Q), InvalidArgument, "quaternion"),
    "v long": (lambda: solved(v=np.zeros(19)), InvalidArgument, "v has shape"),
    "v infinite": (lambda: solved(v=with_entry(V, INF)), InvalidArgument, "v"),
    "t nan": (lambda: solved(t=NAN), InvalidArgument, "t "),
    "t an array": (lambda: solved(t=np.zeros(2)), InvalidArgument, "t = array.* has shape"),
    "passive short": (lambda: solved(passive=np.zeros(12)), InvalidArgument, "passive has shape"),
    "passive nan": (lambda: solved(passive=with_entry(V, NAN)), InvalidArgument, "passive"),
    "switched to no scene": (
        lambda: Controller(SCENE, STAND, cones=CONE).use(["FL_FOOT"]),
        InvalidArgument,
        "scene",
    ),
    "switched to unknown contact": (
        lambda: Controller(SCENE, STAND, cones=CONE).use(without(SCENE, ["FL"])),
        UnknownName,
        "FL_FOOT",
    ),
    "switched to another robot": (
        lambda: Controller(SCENE, STAND, cones=CONE).use(
            cp.Scene(robot("go2"), robot("go2").contacts)
        ),
        InvalidArgument,
        "another robot",
    ),
    "switched to no tasks": (
        lambda: Controller(SCENE, STAND, cones=CONE).use(SCENE, []),
        InvalidArgument,
        "tasks",
    ),
    "force of a contact that left": (
        lambda: Controller(SCENE, [*STAND, ContactForce("FL_FOOT")], cones=CONE).use(
            without(SCENE, ["FL_FOOT"])
        ),
        UnknownName,
        "FL_FOOT",
    ),
    "period zero": (
        lambda: at_rate(Controller(SCENE, STAND, cones=CONE), 0),
        InvalidArgument,
        "period = 0",
    ),
    "period nan": (
        lambda: at_rate(Controller(SCENE, STAND, cones=CONE), NAN),
        InvalidArgument,
        "period = nan",
    ),
    "rate of no controller": (lambda: at_rate(SCENE, 1e-3), InvalidArgument, "controller = "),
    "watch no function": (
        lambda: at_rate(Controller(SCENE, STAND, cones=CONE), 1e-3, watch=[]),
        InvalidArgument,
        "watch",
    ),
    "duration zero": (lambda: minimum_jerk(0.0, 1.0, 0.0), InvalidArgument, "duration = 0"),
    "ends of other length": (
        lambda: minimum_jerk(np.zeros(3), np.zeros(2), 1.0),
        InvalidArgument,
        "end has shape",
    ),
    "start nan": (lambda: minimum_jerk(NAN, 1.0, 1.0), InvalidArgument, "start"),
}

FORCES: dict[str, Mistake] = {
    "criterion by class": (
        lambda: gravity_compensation(SCENE, Q, distribution=LeastNorm),
        InvalidArgument,
        "distrib",
    ),
    "criterion a cone": (
        lambda: gravity_compensation(SCENE, Q, distribution=CONE),
        InvalidArgument,
        "distribution",
    ),
    "criterion of a number": (
        lambda: gravity_compensation(SCENE, Q, distribution=LargestMargin(0.6)),
        InvalidArgument,
        "0.6",
    ),
    "criterion of unknown contact": (
        lambda: gravity_compensation(SCENE, Q, distribution=LeastNorm({"FL": CONE})),
        UnknownName,
        "FL_FOOT",
    ),
    "criterion by unknown solver": (lambda: LeastNorm(CONE, qp="DAQP"), InvalidArgument, "qp = "),
    "motion short": (lambda: inverse_dynamics(SCENE, Q, V, V[:-1]), InvalidArgument, "a has shape"),
    "motion nan": (lambda: inverse_dynamics(SCENE, Q, V, with_entry(V, NAN)), InvalidArgument, "a"),
    "operational frame unknown": (lambda: operational_space(SCENE, Q, "hand"), UnknownName, "hand"),
    "operational task unknown": (
        lambda: operational_space(SCENE, Q, "FL_FOOT", task="place"),
        InvalidArgument,
        "task = ",
    ),
    "balance without contacts": (
        lambda: balance(cp.Scene(SOLO), Q, V, V, []),
        InvalidArgument,
        "no contact",
    ),
    "balance lam short": (
        lambda: balance(SCENE, Q, V, V, np.zeros(11)),
        InvalidArgument,
        "lam has shape",
    ),
    "balance a nan": (
        lambda: balance(SCENE, Q, V, with_entry(V, NAN), np.zeros(12)),
        InvalidArgument,
        r"^a\[\d+\] = nan",
    ),
    "balance lam that overflows": (
        lambda: balance(SCENE, Q, V, V, np.full(12, 1e308)),
        InvalidArgument,
        "lam has numbers up to 1e.308",
    ),
    "balance cone a number": (
        lambda: balance(SCENE, Q, V, V, np.zeros(12), cones=0.6),
        InvalidArgument,
        "0.6",
    ),
    "support of a short q": (lambda: support_polygon(SCENE, Q[:-1]), InvalidArgument, "q has"),
    "support of a number": (lambda: support_polygon(SCENE, Q, 0.6), InvalidArgument, "0.6"),
    "margin of two numbers": (
        lambda: support_polygon(SCENE, Q).margin((0, 0)),
        InvalidArgument,
        "point has shape",
    ),
    "push of two numbers": (
        lambda: push_bound(SCENE, Q, (1, 0), cones=CONE),
        InvalidArgument,
        "way has shape",
    ),
    "push of nan": (
        lambda: push_bound(SCENE, Q, (1, NAN, 0), cones=CONE),
        InvalidArgument,
        "way",
    ),
    "push across a floor, but for rounding": (
        lambda: push_bound(SCENE, Q, (1e-17, 0, 1), cones=CONE),
        InvalidArgument,
        "across the plane",
    ),
    "push by nothing": (
        lambda: push_bound(SCENE, Q, (0, 0, 0), cones=CONE),
        InvalidArgument,
        "way",
    ),
    "speed behind the start": (lambda: bound().speed_at(-0.1), InvalidArgument, "s = -0.1 m"),
    "speed at nan": (lambda: bound().speed_at(NAN), InvalidArgument, "s = nan"),
    "speed at many": (lambda: bound().speed_at(np.zeros(3)), InvalidArgument, "s = .* has shape"),
    "push with a contact without cone": (
        lambda: push_bound(SCENE, Q, (1, 0, 0), cones={"FL_FOOT": CONE}),
        InvalidArgument,
        "cones: none for FR_FOOT",
    ),
    "support without a cone": (
        lambda: support_polygon(SCENE, Q, {}),
        InvalidArgument,
        "cones: empty",
    ),
    "wrench margin without a cone": (
        lambda: balance(SCENE, Q, V, V, np.zeros(12), cones={}),
        InvalidArgument,
        "cones: empty",
    ),
    "effort limit nan": (
        lambda: solved(scene=weaker(NAN)),
        CondynError,
        "one of its numbers is NaN",
    ),
}


MISTAKES = TASKS | CONTROLLER | FORCES
assert len(MISTAKES) == len(TASKS) + len(CONTROLLER) + len(FORCES)


@each_row(("mistake", "error", "words"), list(MISTAKES.values()))
def test_a_mistake_is_an_error_that_names_it(
    mistake: Callable[[], Any], error: type[CondynError], words: str
) -> None:
    with pytest.raises(error, match=words.replace("(18,)", r"\(18,\)")):
        mistake()


@pytest.mark.long
def test_without_them_it_stands() -> None:
    assert solved().status.ok


@pytest.mark.parametrize("size", [1e-200, 1e200])
def test_a_way_may_have_any_length(size: float) -> None:
    assert bound(size).impulse == pytest.approx(bound().impulse, rel=1e-12)
    feet = support_polygon(SCENE, Q)
    reach = feet.reach((0, 0, 0), (1, 0, 0))
    assert feet.reach((0, 0, 0), (size, 0, 0)) == pytest.approx(reach, rel=1e-12)
