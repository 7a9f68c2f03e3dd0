"""Robots that stand under pushes from all sides, every tick looked at.

    python benchmarks/standing.py [--only solo12] [--share 0.98]

--only and --share measure some rows anew, and leave the others as they are.

A whole-body controller at 1 kHz knows the feet as contacts that hold; on the floor they open and
slide. Every three seconds, in which it comes to rest again, the base is pushed for 50 ms with a
share of the impulse from which a robot can stand without a step, and beyond which it cannot. Twelve
pushes, 30 degrees apart from one towards a corner of the support on, make four runs of 10 s. A
second before a push, at rest, feet are taken to belong where they have come down, and the mass
above their middle. The bound is that of the state in which a push begins. With p(s) the farthest
pressure that motors and floor allow where the mass has moved by s from there (`push_bound`),
h the height of the centre of mass and h_F that of the base, on which F acts,

    s'' = omega^2 (s - p(s)) + F h_F / (m h),    omega = sqrt(g / h),

and when the push ends, `PushBound.speed_at` says whether it stops. The share of m omega d, with d
from the middle of the support to its edge, is in the table as well: it is the bound for an impulse
through the centre of mass, in no time, on a floor of any friction, by motors of any strength.
"""

from __future__ import annotations

import os
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import script
from script import Table

import condyn_pin as cp
from condyn_pin._core._pin import pin
from condyn_pin.contact import FrictionCone, WrenchCone
from condyn_pin.contact.cones import Cone
from condyn_pin.control import (
    Balance,
    CapturePoint,
    ControlAnswer,
    Controller,
    Orientation,
    Posture,
    PushBound,
    at_rate,
    balance,
    push_bound,
)
from condyn_pin.mechanism import anchored, place_on_ground

# base, cone of the controller within that of the floor, and step [s]
ROBOTS: dict[str, tuple[str, Cone, float]] = {
    "solo12": ("base_link", FrictionCone(0.69, sides=16), 1e-3),
    "cassie": ("pelvis", FrictionCone(0.65, sides=8), 5e-4),
    "talos": ("base_link", WrenchCone(0.5), 1e-3),
}
SHARES = {"solo12": (0.98, 1.25), "cassie": (0.98, 1.25), "talos": (0.98, 1.25)}
PERIOD, EVERY, FIRST, LASTS, FRICTION = 1e-3, 3.0, 1.0, 0.05, 0.7  # [s], ..., [1]
RUNS, PUSHES, DURATION = 4, 3, 10.0  # a row: runs, pushes of each, how long each takes [s]
GRAVITY = 9.81  # [m/s^2]
FEET = 3.0  # over omega: feet that a push takes off are drawn back to where they stood
FALLEN = 0.6  # of the height of the base
# What motors give here, by what the names of joints end in, where the files have no limit, or
# 1000: about as much as those of the machines [N m]. Without a limit what falls is flung about.
TORQUES = {
    "solo12": {"HAA": 2.7, "HFE": 2.7, "KFE": 2.7},
    "cassie": {
        "roll-op": 112.5,
        "yaw-op": 112.5,
        "pitch-op": 195.2,
        "knee-op": 195.2,
        "foot-op": 45.0,
    },
}


@dataclass
class Row:
    """One robot under pushes of one size."""

    robot: str
    share: float
    runs: int = 0
    stood: int = 0  # to the end, on its feet
    on: str = ""  # processor and date
    ticks: int = 0
    not_ok: int = 0
    plain: list[float] = field(default_factory=list)  # shares of m omega d, of all pushes
    kkt: float = 0.0  # [m/s^2], the worst
    margin: float = 0.0  # [N], the least
    # of runs that stood, the worst each: capture point within the support, centre of mass away [m]
    inside: list[float] = field(default_factory=list)
    away: list[float] = field(default_factory=list)
    fell: list[str] = field(default_factory=list)  # when, and how that ended


class Stand:
    """A robot on the floor, its controller, and where it belongs."""

    def __init__(self, name: str) -> None:
        base, cone, self.dt = ROBOTS[name]
        made = robot_of(name)
        closed = cp.Scene(made, [*made.loops, *made.contacts])
        self.floor = cp.Scene(made, made.loops, contacts=made.frictional_contacts(FRICTION))
        q, self.v = closed.state()
        self.q, self.base = place_on_ground(self.floor, q), base
        self.closed = anchored(closed, self.q)
        now = self.balance(self.q, self.v)
        assert now.polygon is not None
        self.corners = now.polygon.in_world[:, :2]
        self.middle = np.array([*now.polygon.plane.origin[:2], now.com[2]])
        self.mass, self.height = made.mass, float(now.com[2])
        self.lever = float(self.q[2]) / self.height  # the base is the floating body
        self.rigid = [spring.joint for spring in made.springs]
        self.held, self.cone = closed, cone

    def controller(self, q: np.ndarray) -> Controller:
        """Return what holds the feet where they are at q, and the mass above their middle."""
        scene = anchored(self.held, q)
        now = balance(scene, q, 0 * self.v, 0 * self.v, np.zeros(scene.rows))
        assert now.polygon is not None
        middle = now.polygon.plane.origin
        tasks = [
            CapturePoint(reference=(middle[0], middle[1], self.middle[2]), weight=1000),
            Orientation(self.base, kp=100, weight=0.3),  # where the mass needs it, it lets go
            Posture(weight=0.1),
        ]
        feet = cp.Baumgarte.critical(FEET * float(np.sqrt(GRAVITY / self.height)))
        return Controller(
            scene, tasks, cones=self.cone, rigid=self.rigid, drift=feet, engine="auto"
        )

    def balance(self, q: np.ndarray, v: np.ndarray) -> Balance:
        """Return where the mass is, and the capture point."""
        return balance(self.closed, q, v, 0 * v, np.zeros(self.closed.rows))

    def reach(self, way: np.ndarray) -> float:
        """Return how far the edge of the support is from its middle along a unit vector [m]."""
        sides = np.roll(self.corners, -1, axis=0) - self.corners
        out = np.column_stack((sides[:, 1], -sides[:, 0]))
        along, far = out @ way, np.einsum("ij,ij->i", out, self.corners - self.middle[:2])
        return float((far[along > 0] / along[along > 0]).min())

    def ways(self, run: int) -> np.ndarray:
        """Return where the pushes of a run go, unit vectors along the floor (PUSHES, 3)."""
        away = self.corners[0] - self.middle[:2]
        turns = 2 * np.pi * (run + RUNS * np.arange(PUSHES)) / (RUNS * PUSHES)
        angles = np.arctan2(away[1], away[0]) + turns
        return np.column_stack((np.cos(angles), np.sin(angles), 0 * angles))

    def strongest(self, q: np.ndarray, v: np.ndarray, way: np.ndarray) -> float:
        """Return the largest force along a way from which it stops, from the state it is in [N]."""
        cone = floor_of(self.floor.robot.name)
        bound = push_bound(anchored(self.closed, q), q, way, cones=cone, rigid=self.rigid)
        speed = float(self.balance(q, v).com_velocity @ way)
        least, most = 0.0, 10 * bound.impulse / LASTS
        for _ in range(40):
            middle = (least + most) / 2
            stops = self._stops(middle, speed, bound)
            least, most = (middle, most) if stops else (least, middle)
        return least

    def momentum(self, d: float) -> float:
        """Return m omega d [kg m/s]."""
        return self.mass * float(np.sqrt(GRAVITY / self.height)) * d

    def _stops(self, force: float, v: float, bound: PushBound) -> bool:
        c, dt = 0.0, LASTS / 500
        for _ in range(500):
            pressure = np.interp(c, bound.travel, bound.pressure)
            v += dt * (GRAVITY / self.height * (c - pressure) + force * self.lever / self.mass)
            c = max(c + dt * v, 0.0)
        return v <= bound.speed_at(c)


class Pushes:
    """Forces at the base: each a share of the largest that is stood from the state it begins in."""

    def __init__(self, robot: Stand, share: float, run: int) -> None:
        self._robot, self._share, self._ways = robot, share, robot.ways(run)
        self.forces: list[np.ndarray] = []  # of the pushes that have begun [N]

    def __call__(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the force at a time [N]."""
        number, since = int(t / EVERY), t % EVERY - FIRST
        if not (0 <= since < LASTS and number < PUSHES):
            return np.zeros(3)
        if number == len(self.forces):
            way, falls = self._ways[number], self._robot.balance(q, v).capture_margin < 0
            force = 0.0 if falls else self._share * self._robot.strongest(q, v, way)
            self.forces.append(force * way)
        return self.forces[number]

    def plain(self) -> list[float]:
        """Return the pushes as shares of m omega d."""
        sizes = np.linalg.norm(self.forces, axis=1)
        ways = self._ways[: len(sizes), :2]
        most = [self._robot.momentum(self._robot.reach(way)) for way in ways]
        return [float(LASTS * size / each) for size, each in zip(sizes, most, strict=True)]


def floor_of(name: str) -> Cone:
    """Return what the floor can give, a little more where its cone is round."""
    if isinstance(ROBOTS[name][1], WrenchCone):
        return WrenchCone(FRICTION, pyramid="outer")
    return FrictionCone(FRICTION, sides=16, pyramid="outer")


def robot_of(name: str) -> cp.Robot:
    """Return a robot with motors that have a limit."""
    made = cp.load_robot(name)
    model = pin.Model(made.model)
    most = np.array(model.effortLimit)
    for joint in made.actuated:
        for end, torque in TORQUES.get(name, {}).items():
            if joint.endswith(end):
                most[model.joints[model.getJointId(joint)].idx_v] = torque
    model.effortLimit = most
    return replace(made, model=model)


def stand(row: Row, robot: Stand, number: int) -> None:
    """Add a run to a row."""
    pushes = Pushes(robot, row.share, number)
    answers: list[ControlAnswer] = []
    ticks: list[Callable] = []  # of the controllers up to now

    def ask(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        if len(ticks) <= t / EVERY:  # at rest again: feet belong where they have come down
            ticks.append(at_rate(robot.controller(q), PERIOD, watch=answers.append))
        return ticks[-1](t, q, v)

    torque = limp(ask)
    low = FALLEN * robot.q[2]
    fallen = cp.Event(name="fallen", when=lambda now: float(now.q[2]) - low)
    run = cp.simulate(
        robot.floor, robot.q, robot.v, torque, duration=DURATION, dt=robot.dt, events=[fallen],
        forces=[cp.AppliedForce(robot.base, pushes)],
    )  # fmt: skip
    row.plain += pushes.plain()
    end = robot.balance(run.q[-1], run.v[-1])
    stood = run.t[-1] > DURATION - PERIOD and np.linalg.norm(end.com - robot.middle) < 0.05
    row.runs, row.stood = row.runs + 1, row.stood + int(stood)
    row.ticks += len(answers)
    row.not_ok += sum(not answer.status.ok for answer in answers)
    row.kkt = max(row.kkt, *(answer.residuals.kkt for answer in answers))
    margins = (margin.least for answer in answers for margin in answer.margins.values())
    row.margin = min(row.margin, *map(float, margins))
    if stood:
        balances = [robot.balance(q, v) for q, v in zip(run.q[::5], run.v[::5], strict=True)]
        row.inside.append(float(min(each.capture_margin for each in balances)))
        row.away.append(max(float(np.linalg.norm(x.com - robot.middle)) for x in balances))
    else:
        height, away = run.q[-1, 2] / robot.q[2], np.linalg.norm(end.com - robot.middle)
        row.fell.append(
            f"run {number}: answered for {len(answers) * PERIOD:.2f} s; at {run.t[-1]:.2f} s, "
            f"{run.status.name.lower()}, height x {height:.2f}, mass {away:.2f} m away"
        )


def limp(torque: Callable) -> Callable:
    """Return torques that are zero from the first tick on that has none."""
    lost = []

    def given(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        try:
            return 0 * v if lost else torque(t, q, v)
        except cp.SolveFailed as error:
            lost.append(error)
            return 0 * v

    return given


def table(saved: script.Saved) -> str:
    """Return a row a robot and share."""
    rows = [Row(**row) for row in saved["rows"]]
    lines = [
        "| robot | share of the bound | of m omega d | stood | ticks | not ok | worst kkt "
        "| least margin [N] | capture point inside by [m] | mass away by [m] | measured on |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for r in rows:
        inside, away = (f"{min(r.inside):.3f}", f"{max(r.away):.3f}") if r.stood else ("", "")
        lines.append(
            f"| {r.robot} | {r.share:g} | {min(r.plain):.2f} to {max(r.plain):.2f} "
            f"| {r.stood} of {r.runs} | {r.ticks} | {r.not_ok} "
            f"| {r.kkt:.0e} | {r.margin:.0e} | {inside} | {away} | {r.on} |"
        )
    on = "{cores} cores, one thread, {system}, Python {python}, Pinocchio {pinocchio}"
    source = script.source("standing", saved["machine"], on)
    meaning = (
        f"A row: {RUNS} runs of {DURATION:g} s with {PUSHES} pushes each, {EVERY:g} s apart, from "
        f"{RUNS * PUSHES} sides. Share of m omega d: the least and the most of its pushes. Stood: "
        "the mass ends within 5 cm of where it belongs. Capture point and mass: of runs that "
        "stood, the worst of every fifth sample."
    )
    return "\n".join([*lines, "", f"{source}.", meaning])


def measure(given: Namespace) -> script.Saved:
    """Let them stand."""
    about, kept = script.measured_on(), script.result("standing")
    old = script.load("standing")["rows"] if kept.exists() else []
    rows = {(row.robot, row.share): row for row in (Row(**each) for each in old)}
    for name in ROBOTS if given.only is None else (given.only,):
        robot = Stand(name)
        for share in [x for x in SHARES[name] if given.share in (None, x)]:
            row = rows[name, share] = Row(
                name, share, on="{processor}, {date}".format(**about["machine"])
            )
            for number in range(RUNS):
                stand(row, robot, number)
            print(row, flush=True)
    wanted = [(name, share) for name in ROBOTS for share in SHARES[name]]
    return {**about, "rows": [asdict(rows[key]) for key in wanted if key in rows]}


def _options(parser: ArgumentParser) -> None:
    parser.add_argument("--only", choices=ROBOTS)
    parser.add_argument("--share", type=float)


SUBJECTS = [
    Table(
        "standing",
        "robots pushed at random, below what they can stand and beyond",
        measure,
        table,
        pages=lambda saved: {script.RESULTS_PAGE: {"standing": table(saved)}},
        options=_options,
    )
]


if __name__ == "__main__":
    sys.exit(script.main(__doc__, SUBJECTS))
