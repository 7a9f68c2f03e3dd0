"""A constraint kind is one object in one file: the rest of the program asks it.

    c = distance of a point from a line - radius,     c' = n . s,     n' = (1 - n n^T) rho' / |rho|

with rho the part of r across the line, the z axis of the first frame.
"""

from __future__ import annotations

import ast
import importlib.util
import re
import sys
import textwrap
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from viewed import parts

import condyn_pin as cp
from condyn_pin.constraints.constraint import KINDS
from condyn_pin.dynamics.nominal import pinocchio_constraints_of

KIND = '''
"""A point at a distance from a line."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from condyn_pin.constraints.constraint import check_lengths
from condyn_pin.constraints.relation import FrameRelation


@dataclass(frozen=True)
class OnCylinder(FrameRelation):
    """The origin of `frame_b` stays at a distance from the z axis of `frame_a`: 1 row."""

    word: ClassVar[str] = "cylinder"
    lengths: ClassVar[tuple[str, ...]] = ("radius",)

    frame_a: str
    frame_b: str
    radius: float  # [m]

    def __post_init__(self):
        check_lengths(radius=self.radius)
        self._set_name(f"{self.frame_a}~{self.frame_b}")

    @property
    def rows(self):
        return 1

    def violation(self, R, r):
        return np.array([np.hypot(r[0], r[1]) - self.radius])

    def weights(self, R, r):
        return -np.array([[*r[:2], 0, 0, 0, 0]]) / np.hypot(r[0], r[1])

    def weights_rate(self, R, r, s):
        size = np.hypot(r[0], r[1])
        n, rate = r[:2] / size, -s[:2]
        return -np.array([[*((rate - n * (n @ rate)) / size), 0, 0, 0, 0]])
'''

# One with a row of angles: two axes stay across each other, as in the cross of a universal joint.
#     c = z . R x,    c' = (z x R x) . s_ang,    (R x)' = -s_ang x R x
CROSS = '''
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from condyn_pin.constraints.relation import FrameRelation


@dataclass(frozen=True)
class Cross(FrameRelation):
    """The z axis of `frame_a` stays across the x axis of `frame_b`: 1 row."""

    word: ClassVar[str] = "cross"

    frame_a: str
    frame_b: str

    def __post_init__(self):
        self._set_name(f"{self.frame_a}+{self.frame_b}")

    @property
    def rows(self):
        return 1

    def violation(self, R, r):
        return R[2:, 0].copy()

    def weights(self, R, r):
        return np.array([[0, 0, 0, *np.cross([0, 0, 1], R[:, 0])]])

    def weights_rate(self, R, r, s):
        return np.array([[0, 0, 0, *np.cross([0, 0, 1], -np.cross(s[3:], R[:, 0]))]])
'''

# Questions for the kind of a constraint outside of `constraints/`; the number only falls.
QUESTIONS = 0


@contextmanager
def kind_in_a_file(name, text, folder):
    """A new kind, from a file of its own."""
    path = folder / f"{name.lower()}.py"
    path.write_text(text)
    found = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(found)
    sys.modules[path.stem] = module
    found.loader.exec_module(module)
    yield getattr(module, name)
    del KINDS[name], sys.modules[path.stem]


@pytest.fixture(scope="module")
def kind(tmp_path_factory):
    with kind_in_a_file("OnCylinder", KIND, tmp_path_factory.mktemp("kinds")) as found:
        yield found


@pytest.fixture(scope="module")
def robot():
    """Two arms of a floating body."""
    model, rng = pin.Model(), np.random.default_rng(2)
    joints = [(pin.JointModelFreeFlyer(), 0), (pin.JointModelRX(), 1),
              (pin.JointModelSpherical(), 2), (pin.JointModelPY(), 1),
              (pin.JointModelRZ(), 4)]  # fmt: skip
    for joint, parent in joints:
        place = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
        i = model.addJoint(parent, joint, place, f"joint {model.njoints}")
        body = pin.Inertia(1.0 + rng.random(), rng.normal(size=3), np.diag([1.0, 1.2, 1.5]))
        model.appendBodyToJoint(i, body, pin.SE3.Identity())
    for name, i in (("line", 3), ("point", 5)):
        place = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
        model.addFrame(pin.Frame(name, i, 0, place, pin.FrameType.OP_FRAME))
    return cp.Robot("two arms", model)


@pytest.fixture(scope="module")
def scene(kind, robot):
    rail = kind("line", "point", 0.7)
    return cp.Scene(replace(robot, loops=[rail]), [rail, cp.PointContact("point", name="held")])


@pytest.fixture(scope="module")
def state(scene):
    rng = np.random.default_rng(5)
    q, v = scene.sample(rng)
    return q, v, rng.normal(size=scene.robot.nv)


def test_the_rate_of_the_distance_is_j_v(scene, state):
    q, *_ = state
    model, equations, h = scene.robot.model, cp.Workspace(scene).equations, 1e-5
    w = np.random.default_rng(1).normal(size=model.nv)

    def at(step):
        return pin.integrate(model, q, step * w)

    rates = [(equations.violation(at(k * h)) - equations.violation(at(-k * h))) / (2 * k * h)
             for k in (1, 2)]  # fmt: skip
    J_w = (equations.jacobian(q) @ w)[0]
    assert rates[0][0] * 4 / 3 - rates[1][0] / 3 == pytest.approx(J_w, rel=1e-9)


def test_it_is_solved(scene, state):
    solution = cp.solve(scene, *state)
    assert solution.status.ok
    reference = cp.solve(scene, *state, solver=cp.dynamics.Reference())
    assert solution.a == pytest.approx(reference.a, rel=1e-9, abs=1e-9)
    force = solution.forces["line~point"]
    rotation, on_other = force.rotation, force.on_other()
    assert (force.on, force.by, on_other.on) == ("line", "point", "point")
    assert np.linalg.norm(force.components[:3]) == pytest.approx(abs(float(force.lam[0])))
    assert (rotation @ force.components[:3])[:3] == pytest.approx(-on_other.in_world()[:3])


@pytest.mark.parametrize("drift", [None, cp.Baumgarte(3.0, 5.0)])
def test_it_is_differentiated(scene, state, drift):
    cp.derivatives(scene, *state, drift=drift, check=True)


def test_frames_of_it_are_differentiated(scene, state):
    h, name = 1e-5, "line~point"
    free = cp.Scene(scene.robot, scene.constraints[:1])
    of = cp.derivatives(free, *state)
    for frame, which in (("line", "first"), ("point", "second")):
        x = np.random.default_rng(7).normal(size=6)
        ends = []
        for step in (h, -h):
            model = pin.Model(scene.robot.model)
            i = model.getFrameId(frame)
            model.frames[i].placement = model.frames[i].placement * pin.exp6(step * x)
            moved = cp.Scene(replace(scene.robot, model=model), free.constraints)
            ends.append(cp.solve(moved, *state).a)
        found = of.by_placement(name, which)[0]
        assert found @ x == pytest.approx((ends[0] - ends[1]) / (2 * h), rel=1e-4, abs=1e-5)


def test_it_is_simulated_and_saved(scene, state, tmp_path):
    q, v, _ = state
    run = cp.simulate(scene, q, v, duration=0.05, dt=0.001, drift=cp.simulation.Projection())
    assert run.violation.max() < 1e-9
    run.save(tmp_path / "run.npz")
    again = cp.Trajectory.load(tmp_path / "run.npz")
    assert again.scene.constraints[0] == scene.constraints[0]
    assert (again.q == run.q).all()
    assert again.forces["line~point"].shape == (len(run.t), 1)


def test_it_is_drawn(scene, state):
    drawn = parts(scene, state[0])
    assert {f"closures/line~point/{each}" for each in ("frame_a", "frame_b", "gap")} <= set(drawn)


@pytest.mark.long
def test_summaries_and_gaps_have_it(scene, state):
    assert ("line~point", "OnCylinder", 1) in scene.summary().constraints
    assert pinocchio_constraints_of(scene).unsupported == ("line~point",)
    assert scene.row_names[0] == "line~point.1"
    assert cp.Workspace(scene).violation(state[0])[0] == pytest.approx(0.0, abs=1e-10)


@pytest.mark.long
def test_robot_toml_has_it(kind, robot, tmp_path):
    (tmp_path / "arms.xml").write_text(robot.to_mjcf())
    card = """
        name = "arms"
        description = { file = "arms.xml" }
        loops = [{ kind = "cylinder", frame_a = "line", frame_b = "point", radius = 0.3 }]
    """
    (tmp_path / "robot.toml").write_text(textwrap.dedent(card))
    assert cp.load_robot(tmp_path).loops == (kind("line", "point", 0.3),)


def test_other_units_reach_its_lengths(scene):
    assert scene.constraints[0].in_units(10.0, float).radius == pytest.approx(7.0)


def test_nothing_outside_of_the_room_asks_for_the_kind():
    package = Path(cp.__file__).parent
    found = [
        f"{path.relative_to(package)}:{line}"
        for path in sorted(package.rglob("*.py"))
        if path.relative_to(package).parts[0] != "constraints"
        for line in questions(ast.parse(path.read_text()))
    ]
    assert len(found) <= QUESTIONS, (
        f"{found} ask what kind a constraint is: make the question a method of Constraint, with a "
        "default, in constraints/constraint.py"
    )


def questions(tree):
    """Lines that ask what kind a constraint is: its class, its `kind`, a match of its class."""
    classes = {*KINDS, "BoundBetweenFrames", "BoundCoupling", "BoundRolling", "BoundRelation",
               "FrameRelation", "BetweenFrames",
               "WithWorld", "Nonholonomic", "OnPlane", "Contact"}  # fmt: skip
    of_loops = {"ball", "weld", "hinge", "slider", "planar", "rod", "coupling"}
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and ast.unparse(node.func) in ("isinstance", "issubclass"):
            if names(node.args[1]) & classes:
                yield node.lineno
        elif isinstance(node, ast.Compare):
            sides = [node.left, *node.comparators]
            by_class = any("type(" in ast.unparse(x) for x in sides)
            if by_class and set.union(*map(names, sides)) & classes:
                yield node.lineno
            asked = [x for x in sides if isinstance(x, ast.Attribute) and x.attr == "kind"]
            constraint = any(re.search("loop|constraint|contact|bound|^[bc]$", ast.unparse(x.value))
                             for x in asked)  # fmt: skip
            if constraint and of_loops & {x.value for s in sides for x in ast.walk(s)
                                          if isinstance(x, ast.Constant)}:  # fmt: skip
                yield node.lineno
        elif isinstance(node, ast.match_case) and names(node.pattern) & classes:
            yield node.pattern.lineno


def names(node):
    found = {x.id for x in ast.walk(node) if isinstance(x, ast.Name)}
    return found | {x.attr for x in ast.walk(node) if isinstance(x, ast.Attribute)}


def test_questions_are_found():
    asked = """
        isinstance(c, Loop | cp.constraints.Coupling)
        type(c) is PointContact
        loop.kind == "ball"
        joint.kind == "ball"
        isinstance(c, Constraint)
    """
    assert list(questions(ast.parse(textwrap.dedent(asked)))) == [2, 3, 4]


@pytest.mark.long
def test_rows_of_angles_are_differentiated_where_they_slip_too(robot, tmp_path):
    """The check compares with differences, and J v enters a_ref."""
    with kind_in_a_file("Cross", CROSS, tmp_path) as cross:
        scene, rng = cp.Scene(robot, [cross("line", "point")]), np.random.default_rng(7)
        q = pin.integrate(robot.model, scene.sample(rng)[0], 1e-2 * rng.normal(size=robot.nv))
        v, tau = rng.normal(size=(2, robot.nv))
        drift = cp.Baumgarte(3.0, 2.0)
        found = cp.derivatives(scene, q, v, tau, drift=drift, check=True)
    assert np.abs(found.da_dq).max() > 1.0


def test_an_event_cannot_turn_two_rows_into_a_vector(kind):
    """Both have several numbers; what differs is the axes that they are along."""
    robot = cp.load_robot("four_bar")
    tips = "coupler_tip", "rocker_tip"
    rows, axes = kind(*tips, 0.1), cp.Loop(*tips, name=kind(*tips, 0.1).name)
    event = cp.Event(name="other", at=0.02, scene=cp.Scene(robot, [axes]))
    with pytest.raises(cp.InvalidArgument, match=r"by its rows in one scene, and by axes"):
        cp.simulate(cp.Scene(robot, [rows]), *cp.Scene(robot).state(), duration=0.1, events=[event])
