"""Universal and cylindrical joints where a loop is cut: closed forms, and the joint in the tree."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import condyn_pin as cp

JOINTS = {
    "R": [pin.JointModelRZ],
    "C": [pin.JointModelPZ, pin.JointModelRZ],
    "U": [pin.JointModelRX, pin.JointModelRY],
    "S": [pin.JointModelSpherical],
}
KINDS = {"R": ("hinge", "z"), "C": ("cylindrical", "z"), "U": ("universal", "xy"), "S": ("ball",)}


def shafts(bend: float) -> cp.Scene:
    """Two shafts through one point, the axes off line by `bend`, joined by a universal joint."""
    model = pin.Model()
    for name, turned, inertia in (("one", 0.0, 0.3), ("two", -bend, 0.7)):
        axes = pin.SE3(pin.exp3(np.array([turned, 0.0, 0.0])), np.zeros(3))
        i = model.addJoint(0, pin.JointModelRZ(), axes, name)
        body = pin.Inertia(1.0, np.zeros(3), np.diag([1.0, 1.0, inertia]))
        model.appendBodyToJoint(i, body, pin.SE3.Identity())
    robot = cp.Robot("shafts", model)
    return cp.Scene(robot, [cp.Loop("one", "two", "universal", axis="xy", name="cross")])


@pytest.mark.parametrize("bend", [0.0, 0.4, 1.2])
def test_a_universal_joint_turns_by_cardans_formula(bend):
    """tan b = cos(bend) tan a;  b' = rho a',  rho = cos(bend) / (1 - sin^2(bend) sin^2 a)."""
    scene, torque = shafts(bend), np.array([0.4, -1.1])
    assert scene.rank().mobility == scene.summary().mobility == 1
    assert scene.summary().constraints == (("cross", "Loop (universal)", 4),)
    for a in np.linspace(-1.4, 1.4, 7):
        c, s = np.cos(bend), np.sin(bend)
        below = 1.0 - (s * np.sin(a)) ** 2
        rho, rate = c / below, 1.7
        turning = 2.0 * c * s**2 * np.sin(a) * np.cos(a) / below**2 * rate**2  # rho' a'
        q, v = np.array([a, np.arctan(c * np.tan(a))]), rate * np.array([1.0, rho])
        found = cp.solve(scene, q, v, torque)
        assert found.status.ok
        assert max(found.state_error.position, found.state_error.velocity) < 1e-12
        driven = torque[0] + rho * torque[1] - 0.7 * rho * turning
        first = driven / (0.3 + 0.7 * rho**2)
        assert found.a == pytest.approx([first, rho * first + turning], abs=1e-11)
        between = found.forces["cross"].generalized()[0]
        assert between == pytest.approx(0.3 * first - torque[0], abs=1e-11)


class Machine:
    """A chain of joints from the world back to the world, of letters of `JOINTS`, cut at one."""

    def __init__(self, letters: str, cut: int) -> None:
        rng = np.random.default_rng(8)
        places = [pin.SE3(pin.exp3(rng.normal(size=3)), rng.uniform(-0.6, 0.6, 3)) for _ in letters]
        bodies = []
        for _ in letters[1:]:
            round_ = np.diag(rng.uniform(0.1, 0.2, 3))
            bodies.append(pin.Inertia(rng.uniform(1.0, 2.0), rng.normal(size=3) / 5, round_))
        model, drawn = pin.Model(), {0: pin.SE3.Identity()}
        # bodies are drawn where the world is; body k is between the joints k and k + 1
        ahead, behind = [], 0
        for k in range(cut):
            behind = self._add(model, drawn, behind, letters[k], k, places[k], 1.0)
            model.appendBodyToJoint(behind, bodies[k], drawn[behind].inverse())
            ahead.append(behind)
        last, back = 0, []
        for k in range(len(letters) - 1, cut, -1):
            last = self._add(model, drawn, last, letters[k], k, places[k], -1.0)
            model.appendBodyToJoint(last, bodies[k - 1], drawn[last].inverse())
            back.append(last)
        self.bodies = [(i, drawn[i].inverse()) for i in (*ahead, *back[::-1])]
        kind, *axis = KINDS[letters[cut]]
        for name, i in (("one", behind), ("two", last)):
            place = drawn[i].actInv(places[cut])
            model.addFrame(pin.Frame(name, i, 0, place, pin.FrameType.OP_FRAME))
        self.cut = cp.Loop("one", "two", kind, *axis, name=f"joint {cut}")
        self.robot = cp.Robot(letters, model)
        self.scene = cp.Scene(self.robot, [self.cut])

    @staticmethod
    def _add(model, drawn, parent, letter, k, place, way) -> int:
        """Add a joint, its coordinates in reverse order where it is climbed from its child."""
        parts = JOINTS[letter][:: int(way)]
        for n, part in enumerate(parts):
            name = f"joint {k}" if n == len(parts) - 1 else f"joint {k}, {n}"
            parent = model.addJoint(parent, part(), drawn[parent].actInv(place), name)
            drawn[parent] = place
        return parent

    def motion(self, q, v, a):
        """Placements, velocities and accelerations of the bodies, in the world as drawn."""
        model, data = self.robot.model, self.robot.model.createData()
        pin.forwardKinematics(model, data, q, v, a)
        placed = [(data.oMi[i] * M).homogeneous for i, M in self.bodies]
        moved = [[M.actInv(x[i]).vector for i, M in self.bodies] for x in (data.v, data.a)]
        return np.array(placed), *np.array(moved)

    def state(self, v_bodies):
        """State as drawn, with the velocities of the bodies."""
        model, q = self.robot.model, pin.neutral(self.robot.model)
        columns = [self.motion(q, e, 0 * e)[1].ravel() for e in np.eye(model.nv)]
        v, left, *_ = np.linalg.lstsq(np.array(columns).T, v_bodies.ravel())
        assert left.sum() < 1e-20
        return q, v


def moving(letters: str):
    """A machine cut at its first joint, and at the last, with a velocity of its bodies."""
    first = Machine(letters, len(letters) - 1)
    q, _ = first.state(np.zeros((len(letters) - 1, 6)))
    J = cp.Workspace(first.scene).jacobian(q)
    v = np.linalg.svd(J)[2][-1]
    return first.motion(q, v, 0 * v)[1]


MACHINES = ["RRSC", "RRCS", "RUSR", "RSUR", "RUCC", "RUUC"]


@pytest.mark.parametrize("letters", MACHINES)
def test_no_answer_hangs_on_the_joint_that_is_cut(letters):
    velocity = 3.0 * moving(letters)
    answers = []
    for cut in range(len(letters)):
        machine = Machine(letters, cut)
        q, v = machine.state(velocity)
        found = cp.solve(machine.scene, q, v, np.zeros(machine.robot.nv))
        assert found.status.ok
        assert found.state_error.velocity < 1e-12
        _, _, a = machine.motion(q, v, found.a)
        wrenches = []
        for k in range(len(letters)):
            bearing = found.bearings()[f"joint {k}"]
            assert bearing.determined.all()
            force, moment = bearing.in_world().reshape(2, 3)
            # from the other end where the tree climbs back from the world
            side = -1.0 if k > cut else 1.0
            wrenches.append(side * np.array([*force, *(moment + np.cross(bearing.at, force))]))
        answers.append((a, np.array(wrenches)))
        assert machine.scene.rank().mobility == freedom(letters)
    for a, wrenches in answers[1:]:
        assert a == pytest.approx(answers[0][0], rel=1e-10, abs=1e-10)
        assert wrenches == pytest.approx(answers[0][1], rel=1e-10, abs=1e-9)


def freedom(letters: str) -> int:
    """Freedoms of a loop in space: those of its joints less six."""
    return sum({"R": 1, "C": 2, "U": 2, "S": 3}[letter] for letter in letters) - 6


@pytest.mark.parametrize(("letters", "new"), [("RRSC", "C"), ("RSUR", "U")])
def test_it_moves_as_with_the_joint_in_the_tree(letters, new):
    velocity, ends = moving(letters), []
    exact = cp.simulation.DormandPrince(1e-12, 1e-12, method=8)
    for cut in (letters.index("S"), letters.index(new)):
        machine = Machine(letters, cut)
        q, v = machine.state(velocity)
        run = cp.simulate(machine.scene, q, v, duration=0.3, integrator=exact)
        ends.append(machine.motion(run.q[-1], run.v[-1], 0 * run.v[-1])[:2])
    for one, two in zip(*ends, strict=True):
        assert one == pytest.approx(two, abs=1e-10)


@pytest.mark.parametrize(
    ("kind", "axis"), [("cylindrical", "x"), ("cylindrical", "y"), ("universal", "xy"),
                       ("universal", "zx")]
)  # fmt: skip
@pytest.mark.parametrize("drift", [None, cp.Baumgarte(3.0, 5.0)])
def test_it_is_differentiated(kind, axis, drift):
    """Also where it is open and slips: its derivatives are compared with differences."""
    machine = Machine("RRSC", 1)
    for ends in (("one", "two"), ("two", "one"), ("two", "world")):
        scene = cp.Scene(machine.robot, [cp.Loop(*ends, kind, axis)])
        rng = np.random.default_rng(4)
        q = pin.integrate(machine.robot.model, machine.state(moving("RRSC"))[0], rng.normal(size=6))
        v, tau = rng.normal(size=(2, 6))
        cp.derivatives(scene, q, v, tau, drift=drift, check=True)


@pytest.mark.long
def test_files_have_it(tmp_path):
    (tmp_path / "arms.xml").write_text(cp.model.four_bar().to_mjcf())
    (tmp_path / "robot.toml").write_text(
        'name = "arms"\ndescription = { file = "arms.xml" }\nloops = [\n'
        '{ kind = "universal", axis = "zx", frame_a = "coupler_tip", frame_b = "rocker_tip" },\n'
        '{ kind = "cylindrical", axis = "y", frame_a = "coupler_tip", frame_b = "rocker_tip", '
        'name = "other" }]'
    )
    one, two = cp.load_robot(tmp_path).loops
    assert one == cp.Loop("coupler_tip", "rocker_tip", "universal", "zx")
    assert two == cp.Loop("coupler_tip", "rocker_tip", "cylindrical", "y", name="other")
