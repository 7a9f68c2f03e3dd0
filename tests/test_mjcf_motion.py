"""What an MJCF says of the motion is in the model, or is named: MuJoCo judges.

Random models have all that is modelled, so that M, h, passive forces and equalities have to be
those of MuJoCo. What is not modelled moves MuJoCo's terms away from ours, and has its sentence.
"""

from __future__ import annotations

import itertools
import re
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from fuzz import assert_survived
from referee import MujocoReferee
from shared import each_row

import condyn_pin as cp
from condyn_pin._core._pin import dry_friction
from condyn_pin.constraints import Coupling, HeldJoint, JointFriction
from condyn_pin.control import Actuation
from condyn_pin.errors import InvalidModel, UnmodelledWarning
from condyn_pin.model import CoupledMotor

AGREES = 1e-10
# Whether this MuJoCo knows of armature and damping of actuators, of polynomials, and of yield.
KNOWN = hasattr(mujoco.MjModel.from_xml_string("<mujoco/>"), "jnt_springyield")

# Random models ------------------------------------------------------------------------------------


def numbers(values) -> str:
    return " ".join(repr(float(x)) for x in np.atleast_1d(values))


class RandomModel:
    """A random MJCF with every joint and everything of tendons, actuators, equalities we model."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.scalar: list[str] = []
        self.balls: list[str] = []
        self.sites = ["at_world"]
        self.count = 0
        roots = "".join(self.body(depth, free) for depth, free in ((3, True), (2, False)))
        self.text = (
            f'<mujoco model="random"><compiler angle="radian"/><option gravity="{self.some(3)}"/>'
            f'<worldbody><site name="at_world" pos="{self.some(3)}"/>{roots}</worldbody>'
            f"<tendon>{self.tendons()}</tendon><actuator>{self.actuators()}</actuator>"
            f"<equality>{self.equalities()}</equality></mujoco>"
        )

    def some(self, n: int = 1) -> str:
        return numbers(self.rng.normal(size=n))

    def size(self) -> str:
        return numbers(self.rng.uniform(0.1, 1.0))

    def body(self, depth: int, free: bool = False) -> str:
        self.count += 1
        me = self.count
        site = f"site{me}"
        self.sites.append(site)
        joints = [f'<joint name="free{me}" type="free" damping="{self.size()}"/>']
        if not free:
            kinds = self.rng.choice(["hinge", "slide", "ball"], self.rng.integers(0, 3))
            moves = [kind for kind in kinds if kind != "ball"]
            kinds = [*moves, "ball"] if len(moves) < len(kinds) else moves  # nothing turns after it
            joints = [self.joint(f"j{me}_{i}", kind) for i, kind in enumerate(kinds)]
        a, b = self.rng.uniform(0.1, 0.2, 2)
        moments = numbers([a, b, self.rng.uniform(abs(a - b), a + b)])
        children = "".join(self.body(depth - 1) for _ in range(self.rng.integers(1, 3)) if depth)
        return (
            f'<body name="b{me}" pos="{self.some(3)}" quat="{self.some(4)}">{"".join(joints)}'
            f'<inertial pos="{self.some(3)}" quat="{self.some(4)}" mass="{self.size()}" '
            f'diaginertia="{moments}"/><site name="{site}" pos="{self.some(3)}"/>{children}</body>'
        )

    def joint(self, name: str, kind: str) -> str:
        said = f'name="{name}" type="{kind}" pos="{self.some(3)}"'
        said += f' armature="{self.size()}" damping="{self.size()}"'
        if kind == "ball":
            self.balls.append(name)
            return f"<joint {said}/>"
        self.scalar.append(name)
        said += f' axis="{self.some(3)}" ref="{self.some()}" springref="{self.some()}"'
        return f'<joint {said} stiffness="{self.size()}" frictionloss="{self.size()}"/>'

    def carried(self, *names: str) -> str:
        return " ".join(f'{name}="{self.size()}"' for name in names)

    def tendons(self) -> str:
        words = ("armature", "damping", "stiffness", "frictionloss")
        made = [
            f'<fixed name="t{k}" {self.carried(*words)} springlength="{self.some()}">'
            f'<joint joint="{joint}" coef="{self.some()}"/></fixed>'
            for k, joint in enumerate(self.scalar)
        ]
        pulled = "".join(f'<joint joint="{joint}" coef="{self.some()}"/>' for joint in self.scalar)
        made += [f'<fixed name="sum">{pulled}</fixed>'] if len(self.scalar) > 1 else []
        moved = self.rng.permutation(self.sites)[:2]
        ends = "".join(f'<site site="{site}"/>' for site in moved)
        length = self.size()
        made.append(
            f'<spatial name="straight" {self.carried("damping", "stiffness")} '
            f'springlength="{length}">{ends}</spatial>'
        )
        return "".join(made)

    def actuators(self) -> str:
        words = ("armature", "damping") if KNOWN else ()
        return "".join(
            f'<motor {on}="{name}" gear="{self.some()}" {self.carried(*words)}/>'
            for on, names in (
                ("joint", self.scalar + self.balls), ("jointinparent", self.balls),
                ("tendon", [f"t{k}" for k in range(len(self.scalar))]),
            )
            for name in names
        )  # fmt: skip

    def equalities(self) -> str:
        numbered = list(enumerate(self.scalar))
        self.rng.shuffle(numbered)
        made = []
        kinds = [("joint", 1), ("joint", 2), ("tendon", 1), ("tendon", 2)]
        for tag, n in kinds:
            ends = [numbered.pop() for _ in range(min(n, len(numbered)))]
            names = [name if tag == "joint" else f"t{k}" for k, name in ends]
            if names:
                said = " ".join(f'{tag}{i + 1}="{name}"' for i, name in enumerate(names))
                made.append(f'<{tag} {said} polycoef="{self.some(5 if n == 2 else 1)}"/>')
        if len(self.scalar) > 1:
            made.append(f'<tendon tendon1="sum" polycoef="{self.some()}"/>')
        return "".join(made)


def read_text(folder: Path, text: str) -> cp.Robot:
    path = folder / "robot.xml"
    path.write_text(text)
    return cp.load_robot(path)


def terms(robot: cp.Robot, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, ...]:
    found = cp.Workspace(cp.Scene(robot)).terms(q, v)
    return found.M, found.h, robot.passive_torque(q, v)


def state_of(robot: cp.Robot, seed: int) -> tuple[np.ndarray, np.ndarray]:
    step, v = np.random.default_rng(seed).normal(size=(2, robot.nv))
    return pin.integrate(robot.model, robot.postures["qpos0"], step), v


def off(ours: np.ndarray, theirs: np.ndarray) -> float:
    return float(np.abs(ours - theirs).max() / max(np.abs(theirs).max(), 1.0))


@pytest.mark.parametrize("seed", range(12))
def test_random_models_move_as_in_mujoco(tmp_path, seed):
    text = RandomModel(seed).text
    robot = read_text(tmp_path, text)
    assert robot.unmodelled == ()
    assert robot.name == "random"
    referee = MujocoReferee(robot, text)
    for k in range(3):
        q, v = state_of(robot, k)
        theirs = referee.mass_matrix(q), referee.bias(q, v), referee.passive(q, v)
        assert max(map(off, terms(robot, q, v), theirs)) < AGREES
        violation, J = referee.equality(q)
        workspace = cp.Workspace(cp.Scene(robot, robot.loops))
        ours = workspace.jacobian(q)
        assert ours.shape == J.shape
        scale = (ours * J).sum(axis=1) / (ours**2).sum(axis=1)  # a row may have any length
        assert off(scale[:, None] * ours, J) < AGREES
        assert off(scale * workspace.violation(q), violation) < AGREES


@pytest.mark.parametrize("seed", range(4))
def test_random_models_are_written_and_read_again(tmp_path, seed):
    one = read_text(tmp_path, RandomModel(seed).text)
    two = read_text(tmp_path, one.to_mjcf())
    assert [loop.called for loop in one.loops] == [loop.called for loop in two.loops]
    assert one.spring_dampers == two.spring_dampers
    q, v = state_of(one, seed)
    assert max(map(off, terms(two, q, v), terms(one, q, v))) < AGREES
    gaps = [cp.Workspace(cp.Scene(r, r.loops)).violation(q) for r in (one, two)]
    assert np.allclose(*gaps, rtol=0.0, atol=1e-12)


def test_the_files_check_finds_no_difference(tmp_path):
    """`compare` knows of gears and tendons, too."""
    text = RandomModel(0).text
    robot = read_text(tmp_path, text)
    check = cp.study.MujocoBridge(robot, mujoco.MjModel.from_xml_string(text)).compare(
        *state_of(robot, 0), np.zeros(robot.nv)
    )
    assert not check.causes
    assert not any("tendons" in note for note in check.notes)


@pytest.mark.once  # MuJoCo's compiler reads it
@pytest.mark.parametrize("seed", range(2))
def test_a_spoilt_random_model_is_refused_or_read(tmp_path, seed):
    assert_survived(tmp_path, "robot.xml", RandomModel(seed).text, seed)


# One by one ---------------------------------------------------------------------------------------

TWO = """<mujoco><compiler angle="radian"/>OPTION<worldbody><site name="wall" pos="1 0 0"/>
<body name="a"><joint name="j" axis="0 1 0"/><site name="sa" pos="0 0 0.2"/>
<inertial pos="0.1 0.02 -0.2" mass="1.3" diaginertia="0.01 0.02 0.015"/>
<body name="b" pos="0 0 -0.4"><joint name="k" axis="0 1 0" ref="0.2"/><site name="sb"/>
<inertial pos="0.05 0 -0.1" mass="0.7" diaginertia="0.004 0.005 0.003"/>
<body name="c"><joint name="l" type="slide"/>
<inertial pos="0.05 0 -0.1" mass="0.2" diaginertia="0.004 0.005 0.003"/></body></body></body>
<body name="ball"><joint name="ball" type="ball" BALL/><site name="on_ball" pos="0 0 1"/>
<inertial pos="0.05 0 -0.1" mass="0.7" diaginertia="0.004 0.005 0.003"/></body>
<body name="box"><joint name="free" type="free" FREE/>
<inertial pos="0.05 0 -0.1" mass="0.7" diaginertia="0.004 0.005 0.003"/></body>
</worldbody>MORE</mujoco>"""


def two(more: str = "", *, option: str = "", ball: str = "", free: str = "") -> str:
    text = TWO.replace("MORE", more).replace("OPTION", option)
    return text.replace("BALL", ball).replace("FREE", free)


def pull(words: str, *joints: str) -> str:
    tied = "".join(f'<joint joint="{joint}" coef="{i + 2}"/>' for i, joint in enumerate(joints))
    return f'<tendon><fixed name="t" {words}>{tied}</fixed></tendon>'


def spatial(words: str, *sites: str) -> str:
    ends = "".join(f'<site site="{site}"/>' for site in sites)
    return f'<tendon><spatial name="t" {words}>{ends}</spatial></tendon>'


def motor(words: str) -> str:
    return f"<actuator>{words}</actuator>"


def equal(words: str) -> str:
    return f"<equality>{words}</equality>"


ALL = 'armature="0.5" damping="1" stiffness="3" frictionloss="2" range="0 1"'
# What changes the motion and is not modelled, and what is said of it. Where MuJoCo of before has no
# such attribute there is nothing to say.
LOST = {
    "tendon": (two(pull(ALL, "j", "k")),
               r"^tendon 't', over j, k: armature 0.5, damping 1, stiffness 3, dry friction 2, li"),
    "tendon with slack": (two(pull('stiffness="3" springlength="0.1 0.3"', "j")),
                          "^tendon 't', over j: stiffness 3 from 0.1 to 0.3 m slack$"),
    "tendon that carries": (two(spatial('armature="2"', "sa", "wall")), "spatial: armature 2$"),
    "tendon that bends": (two(spatial('stiffness="2"', "sa", "wall", "sb")), "l: stiffness 2$"),
    "tendon that drives": (two(spatial('stiffness="-2"', "sa", "wall")), "l: stiffness -2$"),
    "polynomial of several": (
        two(pull("", "j", "k") + pull("", "l").replace('"t"', '"u"')
            + equal('<tendon tendon1="u" tendon2="t" polycoef="0.1 0.5 0.2"/>')),
        r"^equality 'tendon0' couples l, j, k by a polynomial, polycoef \[0.1, 0.5, 0.2,"),
    "a tendon in space": (two(spatial("", "sa", "wall") + equal('<tendon tendon1="t"/>')),
                          "^equality 'tendon0', of tendons that are not fixed ones$"),
    "lifted": (two().replace('<body name="a"', '<body name="a" gravcomp="0.5"'),
               r"^gravity compensation of bodies \(a\)$"),
    "a medium": (two(option='<option density="1"/>'), "^the medium"),
    "spring of a ball": (two(ball='stiffness="2"'), r"^springs of free joints and balls \(ball\)$"),
    "spring of a free": (two(free='stiffness="2"'), r"^springs of free joints and balls \(free\)$"),
    "rotor of a free": (two(free='armature="2"'), r"^armature of free joints \(free\)$"),
    "cone of a ball": (two(ball='range="0 1"'), r"^limits of balls \(ball\)$"),
}  # fmt: skip
NEWER = {
    "motor of a tendon": (two(pull("", "j", "k") + motor('<motor tendon="t" armature="2"/>')),
                          "^tendon 't', over j, k: armature 2$"),
    "polynomial spring": (two().replace('name="j"', 'name="j" stiffness="1 0.2"'),
                          r"^springs that are polynomials, linear here \(j\)$"),
    "polynomial damping": (two().replace('name="j"', 'name="j" damping="1 0.2"'),
                           r"^damping that is a polynomial, linear here \(j\)$"),
    "of a tendon": (two(pull('damping="1 0.2" stiffness="1 2"', "j")), r"tendons that is .*\(t\)$"),
    "of a motor": (two(motor('<motor name="m" joint="j" damping="1 0.2"/>')), r"actuators .*\(m\)"),
    "yields": (two().replace('name="j"', 'name="j" stiffness="1" springyield="0.1"'),
               r"^springs that yield, elastic here \(j\)$"),
    "rotor of a free": (two(motor('<motor joint="free" armature="2"/>')), r"armature .*\(free\)"),
}  # fmt: skip


@each_row(("text", "said"), [*LOST.values(), *(NEWER.values() if KNOWN else ())])  # fmt: skip
def test_what_is_not_modelled_is_named(tmp_path, text, said):
    with pytest.warns(UnmodelledWarning, match="changes the motion, and is not modelled"):
        robot = read_text(tmp_path, text)
    assert any(re.search(said, line) for line in robot.unmodelled), robot.unmodelled
    summary = cp.Scene(robot, robot.loops).summary()
    assert summary.unmodelled == robot.unmodelled
    rows = [line for line in robot.unmodelled if line.startswith("equality")]
    assert all(any(line in note for note in summary.notes) for line in rows)


SERVOS = {
    "servo": (two(motor('<position name="p" joint="j" kp="3"/>')), r"\(p\)"),
    "brake": (two(motor('<velocity joint="j" kv="3"/>')), r"\(actuator0\)"),
    "bias": (two(motor('<general joint="j" biastype="affine" biasprm="1 0 0"/>')), "servos"),
    "muscle": (two(motor('<muscle joint="j" lengthrange="0 1"/>')), "servos"),
}  # fmt: skip


@pytest.mark.long
@each_row(("text", "said"), SERVOS)
def test_servos_are_named_as_what_tau_is_here(tmp_path, text, said):
    robot = read_text(tmp_path, text)
    assert robot.unmodelled == ()
    assert any("servos" in line and re.search(said, line) for line in robot.unused)


OFF = '<option><flag {}="disable"/></option>'
# What does nothing, and is not said to change the motion.
NOTHING = {
    "springs are off": two(pull('stiffness="3"', "j", "k"), option=OFF.format("spring")),
    "dampers are off": two(pull('damping="3"', "j", "k"), option=OFF.format("damper")),
    "friction is off": two(pull('frictionloss="3"', "j", "k"), option=OFF.format("frictionloss")),
    "limits are off": two(pull('range="0 3"', "j", "k"), option=OFF.format("limit")),
    "no constraints": two(equal('<joint joint1="j" polycoef="0 1 2"/>'),
                          option=OFF.format("constraint")),
    "motors are off": two(motor('<position joint="j" kp="3"/>'), option=OFF.format("actuation")),
    "not active": two(equal('<joint joint1="j" joint2="k" polycoef="0 1 2" active="false"/>')),
    "no weight": two(option=OFF.format("gravity")).replace("<body", '<body gravcomp="1"'),
    "wind without air": two(option='<option wind="1 2 3"/>'),
    "tendon on one body": two(spatial('stiffness="3"', "wall", "there")).replace(
        "<worldbody>", '<worldbody><site name="there"/>'),
    "tendon of no length": two('<tendon><fixed stiffness="3" springlength="1"><joint joint="j" '
                               'coef="0"/></fixed></tendon>'),
    "motor": two(motor('<motor joint="j"/>')),
}  # fmt: skip


@each_row("text", NOTHING.values())
def test_what_does_nothing_is_not_named(tmp_path, text):
    robot = read_text(tmp_path, text)
    assert robot.unmodelled == ()
    assert robot.loops == ()
    q, v = state_of(robot, 0)
    referee = MujocoReferee(robot, text)
    assert off(robot.passive_torque(q, v), referee.passive(q, v)) < AGREES


@pytest.mark.long
def test_equalities_hold_and_couple_joints(tmp_path):
    ties = (
        '<joint joint1="k" polycoef="0.3"/><joint name="deep" joint1="j" polycoef="0.1 4 5"/>'
        '<tendon name="t" tendon1="t" polycoef="0.4"/><tendon tendon1="u" tendon2="t" '
        'polycoef="0.1 2"/>'
    )
    more = (
        '<tendon><fixed name="t"><joint joint="j" coef="2"/></fixed><fixed name="u">'
        '<joint joint="j" coef="4"/><joint joint="k" coef="5"/></fixed></tendon>'
    )
    robot = read_text(tmp_path, two(more + equal(ties)))
    # k is drawn at 0.2, and u is 1 long there; 4 j + 5 k - 1 = 0.1 + 2 (2 j) leaves k alone
    assert robot.loops == (
        HeldJoint("k", 0.5, name="joint0"), HeldJoint("j", 0.1, name="deep"),
        HeldJoint("j", 0.2, name="t"), HeldJoint("k", 1.1 / 5.0, name="tendon3"),
    )  # fmt: skip
    pair = two(pull("", "j", "k") + equal('<tendon tendon1="t" polycoef="0.6"/>'))
    (loop,) = read_text(tmp_path, pair).loops  # 2 j + 3 k - 0.6 = 0.6
    assert isinstance(loop, Coupling)
    assert (loop.ratio, loop.offset) == pytest.approx((-1.5, 0.6))


def test_tendons_over_one_joint_have_its_friction_and_limits(tmp_path):
    robot = read_text(
        tmp_path, two(pull(ALL, "j")).replace('name="j"', 'name="j" frictionloss="1" range="-1 9"')
    )
    assert dry_friction(robot.model)[0] == 1.0 + 2.0 * 2.0
    assert robot.model.friction[0] == 5.0
    assert robot.model.lowerPositionLimit[0] == 0.0
    assert robot.model.upperPositionLimit[0] == 0.5
    assert "joint friction (j): a scene has it with robot.frictions()" in robot.unused
    cp.Scene(robot, contacts=[JointFriction("j")])


@pytest.mark.long
def test_motors_are_of_joints_that_something_moves_alone(tmp_path):
    more = (
        '<tendon><fixed name="t"><joint joint="j" coef="2"/></fixed><fixed name="u"><joint '
        'joint="j" coef="1"/><joint joint="k" coef="1"/></fixed></tendon>'
    )
    motors = (
        '<motor tendon="t"/><position name="both" tendon="u"/><motor jointinparent="ball"/>'
        '<motor name="jet" site="sb" gear="1 0 0 0 0 0"/><motor name="crank" slidersite="sa" '
        'cranksite="wall" cranklength="1"/><adhesion name="suck" body="a" ctrlrange="0 1"/>'
    )
    robot = read_text(tmp_path, two(more + motor(motors)))
    assert robot.actuated == ("j", "ball")
    (said,) = (line for line in robot.unused if "no motors here" in line)
    wanted = ("both on tendon 'u'", "jet on site 'sb'", "crank on site", "suck on body 'a'")
    assert all(words in said for words in wanted), said


SUM_AND_DIFFERENCE = (
    '<tendon><fixed name="sum"><joint joint="j" coef="2"/><joint joint="k" coef="3"/></fixed>'
    '<fixed name="difference"><joint joint="k" coef="-1.5"/><joint joint="l" coef="0.2"/></fixed>'
    "</tendon>"
)


def test_motors_on_tendons_over_several_joints_push_as_in_mujoco(tmp_path):
    """B u is MuJoCo's qfrc_actuator, and B^T v the speed of its actuators."""
    motors = (
        '<motor name="a" tendon="sum" gear="5"/><motor name="j" tendon="difference" gear="-2"/>'
        '<motor name="one" joint="l"/><general tendon="sum" gainprm="3" ctrlrange="-4 2"/>'
    )
    text = two(SUM_AND_DIFFERENCE + motor(motors))
    robot = read_text(tmp_path, text)
    actuation = Actuation(robot)
    assert actuation.motors == ("l", "a", "j_motor", "actuator3")
    assert robot.coupled_motors[2].limits == (-12.0, 6.0)
    (said,) = (line for line in robot.unused if "coupled_motors" in line)
    assert re.search("not in Robot.actuated.* on tendon", said)
    motors = cp.Scene(robot).summary().motors
    assert motors == ("l", "a (j, k)", "j_motor (k, l)", "actuator3 (j, k)")
    referee, rng = mujoco.MjModel.from_xml_string(text), np.random.default_rng(0)
    data = mujoco.MjData(referee)
    data.ctrl[:] = ctrl = rng.normal(size=4)
    data.qvel[:] = v = rng.normal(size=robot.nv)
    mujoco.mj_forward(referee, data)
    ours, gains = [2, 0, 1, 3], np.array([1.0, 1.0, 1.0, 3.0])  # by the order of the file
    assert np.allclose(actuation.B @ (gains * ctrl[ours]), data.qfrc_actuator, atol=1e-14)
    assert np.allclose(actuation.B.T @ v, data.actuator_velocity[ours], atol=1e-14)


LIMITED = {
    'forcerange="-3 7"': (-3.0, 7.0),
    'ctrlrange="0 2"': (0.0, 2.0),
    'ctrlrange="-1 2" forcerange="-3 1.5"': (-1.0, 1.5),
    'gainprm="-2" ctrlrange="-1 2"': (-4.0, 2.0),
    'dyntype="filter" dynprm="0.1" ctrlrange="-1 2"': (-np.inf, np.inf),
    'forcelimited="false" forcerange="-3 7"': (-np.inf, np.inf),
}


@pytest.mark.long
@pytest.mark.parametrize(("words", "wanted"), LIMITED.items())
def test_limits_of_motors_on_several_joints(tmp_path, words, wanted):
    general = motor(f'<general name="m" tendon="sum" {words}/>')
    (made,) = read_text(tmp_path, two(SUM_AND_DIFFERENCE + general)).coupled_motors
    assert made == CoupledMotor("m", {"j": 2.0, "k": 3.0}, wanted)


def test_limits_of_motors_are_those_of_their_joints(tmp_path):
    """Of all motors on a joint together, as MuJoCo's forces of actuators at any control."""
    motors = (
        '<motor joint="j" gear="2" ctrlrange="-3 3"/><motor joint="j" gear="-1" forcerange="-2 5"/>'
        '<position joint="k" kp="7" ctrlrange="-1 1" forcerange="-4 4"/><motor joint="l"/>'
    )
    text = two(motor(motors))
    robot = read_text(tmp_path, text)
    efforts = {j: robot.model.effortLimit[robot.model.joints[robot.model.getJointId(j)].idx_v]
               for j in "jkl"}  # fmt: skip
    assert (efforts["j"], efforts["k"]) == (8.0, 4.0)  # 6 + 2 upwards, 6 + 5 downwards
    assert efforts["l"] > 1e300
    (said,) = (line for line in robot.unused if "differ by direction" in line)
    assert "(j)" in said
    referee = mujoco.MjModel.from_xml_string(text)
    data, pushed = mujoco.MjData(referee), []
    for ctrl in itertools.product((-100.0, 100.0), repeat=4):
        data.ctrl[:] = ctrl
        mujoco.mj_forward(referee, data)
        pushed.append(data.qfrc_actuator[[referee.joint(j).dofadr[0] for j in "jk"]].copy())
    assert np.abs(pushed).max(axis=0).tolist() == [11.0, 4.0]
    assert np.max(pushed, axis=0).tolist() == [8.0, 4.0]
    again = read_text(tmp_path, robot.to_mjcf(shapes=False))
    np.testing.assert_array_equal(again.model.effortLimit, robot.model.effortLimit)


@pytest.mark.long
@pytest.mark.parametrize(
    "option",
    [
        '<option actuatorgroupdisable="1"/>',
        '<option><flag actuation="disable"/></option>',
    ],
)
def test_actuators_that_are_switched_off_are_told(tmp_path, option):
    text = two(option + motor('<motor name="m" joint="k" group="1"/>'))
    (said,) = (line for line in read_text(tmp_path, text).unused if "switches off" in line)
    assert said.endswith(": m")


@each_row("words", [
    '<position name="m" tendon="sum" kp="3"/>', '<motor name="m" tendon="sum" gear="0"/>',
    '<general name="m" tendon="sum" gainprm="0" ctrlrange="-1 1"/>',
    '<motor name="m" tendon="sum" ctrlrange="0.1 1"/>',
    '<damper name="m" tendon="sum" kv="2" ctrlrange="0 1"/>',
    '<general name="m" tendon="sum" gaintype="affine" gainprm="2 1 1"/>',
])  # fmt: skip
def test_servos_on_tendons_and_what_never_pushes_are_no_motors(tmp_path, words):
    robot = read_text(tmp_path, two(SUM_AND_DIFFERENCE + motor(words)))
    assert robot.coupled_motors == ()
    assert any("no motors here: m on tendon 'sum'" in line for line in robot.unused)


def test_a_range_of_force_of_a_tendon_limits_the_motor_that_pulls_on_it_alone(tmp_path):
    held = SUM_AND_DIFFERENCE.replace('name="sum"', 'name="sum" actuatorfrcrange="-2 1"')
    text = two(held + motor('<motor name="m" tendon="sum" gear="5" ctrlrange="-9 9"/>'))
    robot = read_text(tmp_path, text)
    (made,) = robot.coupled_motors
    referee = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(referee)
    for limit, ctrl in zip(made.limits, (-9.0, 9.0), strict=True):
        data.ctrl[:] = ctrl
        mujoco.mj_forward(referee, data)
        assert np.allclose(limit * robot.joint_vector(made.weights), data.qfrc_actuator)
    assert not any("ranges of force" in line for line in robot.unused)
    both = motor('<motor name="m" tendon="sum"/><motor name="n" tendon="sum"/>')
    robot = read_text(tmp_path, two(held + both))
    assert [made.limits for made in robot.coupled_motors] == [(-np.inf, np.inf)] * 2
    assert any("tendons that motors share, or over one joint (sum)" in x for x in robot.unused)


@pytest.mark.long
def test_a_range_of_force_of_a_joint_is_its_effort_limit(tmp_path):
    text = two(SUM_AND_DIFFERENCE + motor('<motor name="m" tendon="sum"/>'))
    robot = read_text(tmp_path, text.replace('name="j"', 'name="j" actuatorfrcrange="-2 2"', 1))
    assert 2.0 in robot.model.effortLimit


@pytest.mark.long
def test_a_range_of_force_of_a_tendon_over_one_joint_is_an_effort_limit(tmp_path):
    one = (
        '<tendon><fixed name="t" actuatorfrcrange="-3 3"><joint joint="j" coef="2"/></fixed>'
        "</tendon>"
    )
    text = two(one + motor('<motor name="m" tendon="t" gear="5"/>'))
    robot, referee = read_text(tmp_path, text), mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(referee)
    data.ctrl[:] = 100.0
    mujoco.mj_forward(referee, data)
    assert np.abs(data.qfrc_actuator).max() in robot.model.effortLimit
    assert not any("ranges of force" in line for line in robot.unused)


def test_a_motor_has_a_name_of_its_own(tmp_path):
    motors = motor('<motor name="j" tendon="sum"/><motor name="j_motor" tendon="sum"/>')
    robot = read_text(tmp_path, two(SUM_AND_DIFFERENCE + motors))
    assert [made.name for made in robot.coupled_motors] == ["j_motor_", "j_motor"]
    robot = robot.with_motors("ball", CoupledMotor("ball_0", {"j": 1.0, "k": 2.0}))
    assert read_text(tmp_path, robot.to_mjcf()).coupled_motors[0].name == "ball_0_"


def test_motors_on_several_joints_come_back(tmp_path):
    robot = read_text(tmp_path, two()).with_loops(
        Coupling({"j": 1.0, "k": 2.0, "l": 3.0}, name="a")
    )
    motors = (
        CoupledMotor("a", {"j": 0.1, "k": -0.3}, (0.0, np.inf)),
        CoupledMotor("b", {"k": 1.0, "l": 7.0}, (-2.0, 3.0)),
        CoupledMotor("c", {"k": 1.0, "l": 7.0}),
    )
    again = read_text(tmp_path, robot.with_motors("ball", *motors).to_mjcf())
    assert again.actuated == ("ball",)
    assert again.coupled_motors == motors
    assert again.loops == robot.loops


@pytest.mark.long
@pytest.mark.skipif(not KNOWN, reason="this MuJoCo knows no armature of actuators")
@pytest.mark.parametrize("gear", ["1e200", "1e308"])
def test_what_a_gear_makes_too_large_is_refused(tmp_path, gear):
    with pytest.raises(InvalidModel, match=r"the (armature|damping) of joint 'j' is inf"):
        read_text(tmp_path, two(motor(f'<motor joint="j" gear="{gear}" armature="1"/>')))


@pytest.mark.long
def test_flexible_bodies_are_named(tmp_path):
    cloth = '<flexcomp name="f" type="grid" count="2 2 1" spacing=".1 .1 .1" dim="2" mass="1"/>'
    with pytest.warns(cp.errors.UnmodelledWarning, match=r"flexible bodies.*\(f\)"):
        read_text(tmp_path, two().replace("<worldbody>", f"<worldbody>{cloth}"))


@pytest.mark.long
def test_a_motor_whose_range_has_no_zero_pushes(tmp_path):
    motor_ = motor('<motor name="m" joint="j" ctrllimited="true" ctrlrange="0.1 1"/>')
    robot = read_text(tmp_path, two(motor_))
    assert any("servos, which push at ctrl = 0 (m)" in said for said in robot.unused)


@pytest.mark.long
def test_what_has_no_mass_is_exported_with_next_to_none(tmp_path):
    model = pin.Model()
    for k, inertia in enumerate(
        (pin.Inertia.Zero(), pin.Inertia(1.0, np.ones(3), np.zeros((3, 3))))
    ):
        i = model.addJoint(k, pin.JointModelRY(), pin.SE3(np.eye(3), np.ones(3)), f"j{k}")
        model.appendBodyToJoint(i, inertia, pin.SE3.Identity())
        model.addFrame(pin.Frame(f"b{k}", i, 0, pin.SE3.Identity(), pin.FrameType.BODY))
    robot = cp.Robot("rod", model)
    q, v = np.array([0.3, 0.4]), np.array([1.0, 2.0])
    again = read_text(tmp_path, robot.to_mjcf())
    assert max(map(off, terms(again, q, v), terms(robot, q, v))) < 1e-14
