"""Whole-body control in closed loop: robots that stand on contacts which may open and slide."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from numpy.typing import NDArray
from scipy.linalg import eigh, null_space
from shared import robot

import condyn_pin as cp
from condyn_pin.contact import FrictionCone, WrenchCone
from condyn_pin.contact.cones import Cone
from condyn_pin.control import (
    CapturePoint,
    CenterOfMass,
    ControlAnswer,
    Controller,
    ControlLimits,
    Orientation,
    Posture,
    at_rate,
    balance,
    capturable_speed,
    push_bound,
)
from condyn_pin.dynamics.solution import Sites
from condyn_pin.mechanism import anchored, place_on_ground

pytest.importorskip("proxsuite")

Array = NDArray[np.float64]
OCTAGON = FrictionCone(
    0.6, sides=8
)  # within the cones of the floor: what is asked for, it can give

LONG = pytest.mark.long  # thousands of ticks


class Standing:
    """A robot on the floor under a controller, and every answer that was applied."""

    def __init__(
        self, name: str, base: str, cone: Cone, *, shift: float = 0.0, rigid: Sequence[str] = (),
        torque: float | None = None,
    ) -> None:  # fmt: skip
        made = robot(name)
        if torque is not None:
            model = pin.Model(made.model)
            model.effortLimit[6:] = torque
            made = replace(made, model=model)
        self.base = base
        self.held = cp.Scene(made, [*made.loops, *made.contacts])
        self.floor = cp.Scene(made, made.loops, contacts=made.frictional_contacts(friction=0.7))
        q, self.v = self.held.state()
        self.q = place_on_ground(self.floor, q)
        polygon = self._balance(self.q, self.v).polygon
        assert polygon is not None
        feet = polygon.plane.origin
        com = self._balance(self.q, self.v).com
        self.middle = np.array([feet[0], feet[1] + shift, com[2]])
        tasks = [
            CenterOfMass(reference=self.middle, kp=100, weight=100),
            Orientation(base, kp=100, weight=50),
            Posture(weight=0.1),
        ]
        self.controller = Controller(self.held, tasks, cones=cone, rigid=rigid)
        self.answers: list[ControlAnswer] = []

    def firm(self, k: float = 2.0, trunk: float = 0.3) -> Standing:
        """Return it with a trunk of a weight that lets go, and with feet that are drawn back.

        The capture point decays with k omega, and gaps of the feet with 3.
        """
        omega = float(np.sqrt(9.81 / self.middle[2]))
        tasks = [
            CenterOfMass(reference=self.middle, kp=k * omega**2, kd=(k + 1) * omega, weight=100),
            Orientation(self.base, kp=100, weight=trunk),
            Posture(weight=0.1),
        ]
        self.controller = Controller(
            anchored(self.held, self.q),
            tasks,
            cones=FrictionCone(0.65, sides=8),
            drift=cp.Baumgarte.critical(3 * omega),
            rigid=[spring.joint for spring in self.held.robot.springs],
        )
        return self

    def run(
        self, duration: float, push: Sequence[float] = (0, 0, 0), dt: float = 1e-3
    ) -> cp.Trajectory:
        """Return a motion with a push at the base, from 0.05 to 0.1 s [N s]."""

        def pushed(t: float, q: Array, v: Array) -> Array:
            return np.array(push) / 0.05 if 0.05 <= t < 0.1 else np.zeros(3)

        torque = at_rate(self.controller, 1e-3, watch=self.answers.append)
        forces = [cp.AppliedForce(self.base, pushed)]
        return cp.simulate(
            self.floor, self.q, self.v, torque, duration=duration, dt=dt, forces=forces
        )

    def off(self, run: cp.Trajectory) -> float:
        """How far the centre of mass is from where it belongs at the end [m]."""
        return float(np.linalg.norm(self._balance(run.q[-1], run.v[-1]).com - self.middle))

    def check(self, duration: float) -> None:
        """Every tick was answered, and what it asks the floor for is within the cones."""
        assert len(self.answers) == round(duration / 1e-3) + 1
        assert all(answer.status.ok for answer in self.answers)
        assert max(answer.residuals.kkt for answer in self.answers) <= 1e-9
        margins = [margin.least for each in self.answers for margin in each.margins.values()]
        assert min(float(least) for least in margins) > -1e-9

    def _balance(self, q: Array, v: Array) -> cp.control.Balance:
        return balance(self.held, q, v, 0 * v, np.zeros(self.held.rows))


def solo() -> Standing:
    return Standing("solo12", "base_link", OCTAGON)


@pytest.mark.long
def test_a_robot_stands_on_contacts_that_may_open() -> None:
    standing = solo()
    run = standing.run(0.2)
    assert run.status.ok
    assert np.abs(run.q[-1] - run.q[0]).max() < 1e-6
    standing.check(0.2)
    up = [force[-1, 2] for force in run.forces.values()]
    assert sum(up) == pytest.approx(4 * 6.131, abs=1e-2)


# Impulses that take the capture point a share of the way to the edge of the feet, by m omega d:
# what a robot that does not step can stand, and what it cannot, is on either side of all the way.
@pytest.mark.long
@pytest.mark.parametrize(
    ("way", "share"), [pytest.param((1, 0), 0.8, marks=LONG), ((0, 1), 0.8), ((1, 1), 0.5)]
)
def test_pushes_below_the_capture_point_bound_are_taken_up(
    way: tuple[float, float], share: float
) -> None:
    standing = solo()
    run = standing.run(0.8, impulse(standing, way, share))
    assert run.status.ok
    standing.check(0.8)
    moved = np.linalg.norm(run.q[:, :2] - run.q[0, :2], axis=1)
    assert moved.max() > 0.02
    assert standing.off(run) < 0.2 * moved.max()
    assert all(set(modes[-1:]) == {"stick"} for modes in run.modes.values())


@pytest.mark.parametrize(
    ("way", "d"),
    [pytest.param((1, 0), 0.195, marks=LONG), pytest.param((0, -1), 0.169, marks=LONG),
     ((-1, 1), 0.239)],
)  # fmt: skip
def test_nine_tenths_of_what_a_pendulum_can_stand_are_taken_up(
    way: tuple[float, float], d: float
) -> None:
    """Where a foot comes off, as all but one do towards a corner, it is drawn back."""
    standing = solo().firm()
    height = standing.middle[2]
    speed = capturable_speed(d, height, friction=0.7) * height / standing.q[2]  # of the base
    push = 0.9 * standing.held.robot.mass * speed * np.array([*way, 0.0]) / np.linalg.norm(way)
    run = standing.run(0.9, push)
    assert run.status.ok
    standing.check(0.9)
    assert np.linalg.norm(run.q[:, :2] - run.q[0, :2], axis=1).max() > 0.3 * d
    assert standing.off(run) < 0.01
    assert all(modes[-1] == "stick" for modes in run.modes.values())


@pytest.mark.long
@pytest.mark.parametrize("share", [0.95, 1.3])
def test_towards_a_corner_motors_decide_what_is_taken_up(share: float) -> None:
    """One leg carries all of it, and its hip gives 2.7 N m: a pendulum would stand a fifth more."""
    standing = Standing("solo12", "base_link", OCTAGON, torque=2.7).firm(k=4.0, trunk=5.0)
    d, height = np.array([0.195, 0.169, 0.0]), standing.middle[2]
    floor = FrictionCone(0.7, sides=16, pyramid="outer")
    bound = push_bound(standing.held, standing.q, d, cones=floor)
    assert capturable_speed(float(np.linalg.norm(d)), height, friction=0.7) > 1.18 * bound.speed
    push = share * bound.impulse * height / standing.q[2] * bound.way
    run = standing.run(0.9, push)
    assert (run.status.ok and standing.off(run) < 0.01) == (share < 1)
    hip = standing.held.robot.actuated.index("FL_HFE")
    held = [abs(answer.u[hip]) > 2.699 for answer in standing.answers]
    assert any(held)


def test_cassie_stands_nine_tenths_of_it_sideways_on_feet_that_no_motor_rolls() -> None:
    """One foot carries all of it, the other comes off and is drawn back; springs pass on both."""
    cassie = at_rest()
    run = cassie.run(1.2, sideways(cassie, 0.9), dt=5e-4)
    assert run.status.ok
    cassie.check(1.2)
    assert (run.modes["right-foot/toe"] == "open").any()
    assert all(modes[-1] == "stick" for modes in run.modes.values())
    assert cassie.off(run) < 0.02


@pytest.mark.long
@LONG
@pytest.mark.parametrize(("turn", "share", "lasts"), [(0.0, 0.98, 2.0), (8.0, 0.95, 1.6)])
def test_cassie_stands_at_a_corner_where_her_springs_throw_a_foot_off(
    turn: float, share: float, lasts: float
) -> None:
    """And behind it. The foot comes down flat: what damps it swings up no spring.

    The pressure is at the corner as long as the mass needs it, whatever the trunk would like: to
    turn back the trunk, and the robot on the foot that stands, takes pressure from the edge.
    """
    cassie = at_rest()
    middle, omega = cassie.middle, np.sqrt(9.81 / cassie.middle[2])
    angle = np.arctan2(0.1305, -0.08) + np.radians(turn)  # of the heel, and behind it
    way = np.array([np.cos(angle), np.sin(angle), 0.0])
    floor = FrictionCone(0.7, sides=16, pyramid="outer")
    rigid = [spring.joint for spring in cassie.held.robot.springs]
    bound = push_bound(cassie.held, cassie.q, way, cones=floor, rigid=rigid)
    braked = omega * 0.05  # while it is pushed: with a pressure that stays, by this much
    most = bound.impulse * braked / -np.expm1(-braked) * middle[2] / cassie.q[2]  # at the pelvis
    run = cassie.run(lasts, share * most * way, dt=5e-4)
    assert run.status.ok
    cassie.check(lasts)
    assert (run.modes["right-foot/heel"] == "open").any()
    assert all(modes[-1] == "stick" for modes in run.modes.values())
    assert cassie.off(run) < 0.02


def test_a_capture_point_far_off_comes_back_along_its_line() -> None:
    """The nearest pressure to one far beyond an edge is at a corner, and not on that line."""
    standing = Standing("talos", "base_link", WrenchCone(0.5))
    middle, omega = standing.middle, np.sqrt(9.81 / standing.middle[2])
    polygon = standing._balance(standing.q, standing.v).polygon
    assert polygon is not None
    way = np.array([np.cos(0.35), np.sin(0.35), 0.0])
    v = standing.v.copy()
    v[:3] = 0.9 * omega * polygon.reach(middle, way) * way  # the base is level
    rest = [Orientation("base_link", weight=0.3), Posture(weight=0.1)]
    firm = {"kp": 4 * omega**2, "kd": 5 * omega, "weight": 1000}

    def pressed(task: CapturePoint | CenterOfMass) -> Array:
        """Return where the pressure is, from the middle [m]."""
        controller = standing.controller.use(standing.held, [task, *rest])
        out = controller.solve(standing.q, v)
        assert out.status.ok
        lam = np.concatenate([out.forces[name] for name in standing.held.names])
        found = balance(standing.held, standing.q, v, out.a, lam)
        return np.asarray((found.cop - middle)[:2])

    line = pressed(CapturePoint(reference=middle, k=4.0, weight=1000))
    corner = pressed(CenterOfMass(reference=middle, **firm))
    across = np.array([-way[1], way[0]])
    edge = polygon.reach(middle, way)
    assert abs(across @ line) < 0.15 * edge < 0.3 * edge < abs(across @ corner)
    assert 0.9 * edge < way[:2] @ line


@pytest.mark.long
def test_a_foot_that_the_line_needs_is_not_thrown() -> None:
    """Pushed across the edge behind: by a pressure on that line both heels carry Cassie.

    At the corner nearest to it one foot carries her, and springs throw the other forward, where it
    stays: from there the line between her heels is nearer, and she fell.
    """
    cassie = at_rest()
    angle = np.arctan2(0.1305, -0.08) + np.radians(27.0)
    way = np.array([np.cos(angle), np.sin(angle), 0.0])

    def thrown(task: CapturePoint | CenterOfMass) -> float:
        """Return how far the other foot is from where it stood, 0.15 s after the push [m]."""
        made = cassie.controller
        cassie.controller = made.use(
            made.scene, [task, Orientation("pelvis", weight=0.3), Posture(weight=0.1)]
        )
        run = cassie.run(0.25, 9.6 * way, dt=5e-4)
        foot = cassie.held.robot.frame("right-foot")[0]

        model = cassie.held.robot.unedited
        data = [model.createData() for _ in range(2)]
        for q, each in zip((run.q[0], run.q[-1]), data, strict=True):
            pin.forwardKinematics(model, each, q)
        before, after = (each.oMi[foot].translation for each in data)
        return float(np.linalg.norm(after - before))

    middle, omega = cassie.middle, np.sqrt(9.81 / cassie.middle[2])
    corner = CenterOfMass(reference=middle, kp=4 * omega**2, kd=5 * omega, weight=100)
    assert thrown(CapturePoint(reference=middle, weight=1000)) < 0.004
    assert thrown(corner) > 0.006


def test_behind_a_corner_the_bound_of_cassie_counts_on_both_feet() -> None:
    """There the pressure is between the heels: while a foot is off the floor it cannot be."""
    cassie = at_rest()
    com, left = cassie._balance(cassie.q, cassie.v).com, 0.1305  # [m], the line of the left foot

    def ahead(degrees: float, q: Array) -> tuple[Array, float]:
        """Where the pressure can be, and the impulse, behind the corner of the left heel."""
        angle = np.arctan2(left - com[1], -0.08 - com[0]) + np.radians(degrees)
        way = np.array([np.cos(angle), np.sin(angle), 0.0])
        floor = FrictionCone(0.7, sides=16, pyramid="outer")
        rigid = [spring.joint for spring in cassie.held.robot.springs]
        found = push_bound(cassie.held, q, way, cones=floor, rigid=rigid)
        return com + found.pressure[0] * way, found.impulse

    before, _ = ahead(-3, cassie.q)
    behind, impulse = ahead(3, cassie.q)
    assert before[1] == pytest.approx(left, abs=1e-3)
    assert behind[0] == pytest.approx(-0.08, abs=1e-3)
    assert (left - behind[1]) / (2 * left) == pytest.approx(0.054, abs=0.005)  # on the other foot
    # a foot that came down 11 mm further ahead
    moved = [
        replace(held, anchor=(held.anchor[0] + 0.0114, *held.anchor[1:]))
        if held.name.startswith("left-foot/") else held
        for held in anchored(cassie.held, cassie.q).constraints
    ]  # fmt: skip
    q = cp.Scene(cassie.held.robot, moved).assemble(cassie.q).q
    assert ahead(3, q)[1] < 0.95 * impulse


def at_rest() -> Standing:
    """Return Cassie on springs that have sunk, and that carry it."""
    cassie = Standing("cassie", "pelvis", OCTAGON).firm()
    cassie.q, cassie.v = sunk()
    return cassie


@lru_cache(1)
def sunk() -> tuple[Array, Array]:
    """Return the state of Cassie a second after her springs were let go."""
    rest = Standing("cassie", "pelvis", OCTAGON).firm().run(1.0)
    return rest.q[-1], rest.v[-1]


def sideways(cassie: Standing, share: float) -> Array:
    """Return a share of the largest impulse to the left [N s]."""
    height = cassie.middle[2]
    speed = capturable_speed(0.1305, height, friction=0.7) * height / cassie.q[2]
    return np.array([0.0, share * cassie.held.robot.mass * speed, 0.0])


@pytest.mark.long
def test_a_foot_that_carries_nothing_rattles_on_its_springs_where_gains_are_fast() -> None:
    """What springs pass on swings at 200 / s: torques follow it from tick to tick."""
    cassie = at_rest()
    made, q = cassie.held.robot, cassie.q
    free = null_space(Sites(cassie.held, q).jacobian, rcond=1e-8)
    K = np.zeros(made.nv)
    for spring in made.springs:
        K[made.model.joints[made.model.getJointId(spring.joint)].idx_v] = spring.stiffness
    M = np.array(pin.crba(made.model, made.model.createData(), q))
    M = np.triu(M) + np.triu(M, 1).T
    squares = eigh(free.T * K @ free, free.T @ M @ free, eigvals_only=True)
    assert np.sqrt(squares[-4:]).min() == pytest.approx(205, abs=5)  # [rad/s]

    def change() -> float:
        """Return how much torques change from tick to tick, in the mean [N m]."""
        cassie.answers.clear()
        cassie.run(0.4, sideways(cassie, 0.6), dt=5e-4)
        return float(np.abs(np.diff([each.u for each in cassie.answers], axis=0)).mean())

    slow = change()
    tasks = [
        CenterOfMass(reference=cassie.middle, kp=100, weight=100),
        Orientation("pelvis", kp=100, weight=5),
        Posture(weight=0.1),
    ]
    cassie.controller = Controller(
        cassie.held, tasks, cones=FrictionCone(0.65, sides=8), drift=cp.Baumgarte(50.0, 0.0),
        rigid=[spring.joint for spring in made.springs],
    )  # fmt: skip
    assert change() > 5 * slow


@pytest.mark.parametrize("way", [pytest.param((1, 0), marks=LONG), (0, 1)])
def test_pushes_beyond_it_are_not(way: tuple[float, float]) -> None:
    standing = solo()
    run = standing.run(0.8, impulse(standing, way, 1.2))
    assert not run.status.ok or standing.off(run) > 0.1


def impulse(standing: Standing, way: tuple[float, float], share: float) -> Array:
    """Return the impulse that takes the capture point to a share of the way to the edge [N s]."""
    now = standing._balance(standing.q, standing.v)
    assert now.polygon is not None
    polygon, d = now.polygon, np.array([*way, 0.0]) / np.linalg.norm(way)
    lengths = np.linspace(0.0, 0.5, 5001)  # within the polygon first, and then no more
    outside = bisect_left(lengths, 1, key=lambda x: polygon.margin(now.capture_point + x * d) < 0)
    edge = lengths[outside - 1]
    omega = np.sqrt(9.81 / now.com[2])
    return np.asarray(share * standing.held.robot.mass * omega * edge * d)


def test_cassie_stands_on_loops_and_springs_and_lifts_a_foot_where_it_is_pushed() -> None:
    """From springs at rest: it sinks, its springs carry it, and a push takes a foot off."""
    cassie = Standing("cassie", "pelvis", OCTAGON, rigid=[s.joint for s in robot("cassie").springs])
    run = cassie.run(1.2, (0.0, 5.0, 0.0), dt=5e-4)
    assert run.status.ok
    cassie.check(1.2)
    assert run.violation.max() < 1e-9
    assert (run.modes["right-foot/toe"] == "open").any()
    assert all(modes[-1] == "stick" for modes in run.modes.values())
    assert cassie.off(run) < 5e-3
    # in equilibrium nothing is left to give by springs that are taken for rigid
    assert np.abs(cassie.answers[-1].rigid).max() < 0.1 < 20 < np.abs(cassie.answers[0].rigid).min()


def test_talos_shifts_its_weight_and_is_pushed() -> None:
    """On soles: 5 cm to the left, and 15 N s from behind, which take it to the tip of its toes."""
    talos = Standing("talos", "base_link", WrenchCone(0.5), shift=0.05)
    run = talos.run(1.0, (15.0, 0.0, 0.0))
    assert run.status.ok
    talos.check(1.0)
    assert np.abs(run.q[:, 0] - run.q[0, 0]).max() > 0.01
    assert talos.off(run) < 5e-3
    assert any("tips over" in row for answer in talos.answers for row in answer.active)


@pytest.mark.long
def test_torques_are_held_from_tick_to_tick_and_asked_for_once() -> None:
    standing = solo()
    torque = at_rate(standing.controller, 2e-3, watch=standing.answers.append)
    q, v = standing.q, standing.v
    first = torque(0.0, q, v).copy()
    moved = v + 0.1
    assert (torque(1.9e-3, q, moved) == first).all()
    assert len(standing.answers) == 1
    assert (torque(2e-3 - 1e-15, q, moved) != first).any()  # times of steps are rounded
    assert [answer.t for answer in standing.answers] == [0.0, 2e-3 - 1e-15]
    again = torque(0.0, q, v)  # another run begins
    assert np.allclose(again, first, atol=1e-9)
    torque(0.0, q, moved)  # another state at the same instant is another question
    assert len(standing.answers) == 4


def test_a_tick_without_torques_ends_the_run_with_its_contradiction() -> None:
    standing = solo()
    weak = Controller(
        standing.held, [CenterOfMass(a=(0, 0, -11.0), weight=np.inf)], cones=OCTAGON,
        limits=ControlLimits(torque=False),
    )  # fmt: skip
    with pytest.raises(cp.SolveFailed, match=r"no torques: CenterOfMass\.z gives 1\.19") as raised:
        cp.simulate(standing.floor, standing.q, standing.v, at_rate(weak, 1e-3), duration=0.1)
    assert raised.value.solution.infeasible


# The committed results


@pytest.mark.long
def test_the_committed_rows_stand_below_the_bound_and_fall_beyond(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    root = Path(__file__).resolve().parent.parent
    monkeypatch.syspath_prepend(str(root / "benchmarks"))
    import script
    import standing

    rows = [standing.Row(**row) for row in script.load("standing")["rows"]]
    assert all(row.not_ok == 0 and row.kkt <= 1e-9 and row.margin > -1e-9 for row in rows)
    measured = [(row.robot, row.share) for row in rows]
    assert measured == [(name, x) for name in standing.ROBOTS for x in standing.SHARES[name]]
    assert all(row.stood == 0 for row in rows if row.share > 1)
    assert all(row.stood == row.runs == 4 for row in rows if row.share < 1)
