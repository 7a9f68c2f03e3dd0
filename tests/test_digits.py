"""Digits of files: rounded right angles and twists leave machines the motion that is meant."""

from __future__ import annotations

import pickle
from dataclasses import replace
from math import asin, atan, pi, sin, tan

import numpy as np
import pinocchio as pin
import pytest
from shared import axis_of, each_row

import condyn_pin as cp
from condyn_pin import dynamics, errors, mechanism, simulation

LINK = (
    '<link name="{}"><inertial><origin xyz="0.1 0.01 0.02"/><mass value="1.3"/><inertia ixx="0.01" '
    'iyy="0.02" izz="0.025" ixy="0.001" ixz="0" iyz="0.002"/></inertial></link>'
)
JOINT = (
    '<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
    '<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>'
    '<limit lower="-7" upper="7" effort="99" velocity="99"/></joint>'
)
EXACT = 17


class Description:
    """A URDF that grows, with its angles and axes rounded to some digits."""

    def __init__(self, digits: int) -> None:
        self.digits, self.links, self.joints = digits, ['<link name="base"/>'], []

    def joint(self, name, parent, xyz=(0, 0, 0), rpy=(0, 0, 0), axis=(0, 0, 1), kind="revolute"):
        """A link on a joint: both have one name."""
        massive = kind != "fixed"
        self.links.append((LINK if massive else '<link name="{}"/>').format(f"l_{name}"))
        parent = parent if parent == "base" else f"l_{parent}"
        rounded = [round(float(x), self.digits) for x in rpy]
        self.joints.append(
            JOINT.format(
                name=name, kind=kind, parent=parent, child=f"l_{name}",
                xyz=" ".join(f"{x:.17g}" for x in xyz), rpy=" ".join(map(repr, rounded)),
                axis=" ".join(f"{x:.17g}" for x in axis),
            )
        )  # fmt: skip

    def robot(self, folder, posture=None, **options):
        """The robot of the file."""
        path = folder / f"written_{self.digits}.urdf"
        path.write_text(f'<robot name="r">{"".join(self.links + self.joints)}</robot>')
        robot = cp.load_robot(path, **options)
        if posture is None:
            return robot
        q = np.array(robot.configuration(posture))
        return replace(robot, postures={"drawn": q})


def four_links(digits):
    """The text of a four-bar in x-z whose rocker's pivot is turned by pi/2."""
    text = Description(digits)
    text.joint("crank", "base", axis=(0, 1, 0))
    text.joint("coupler", "crank", xyz=(0.2, 0, 0), axis=(0, 1, 0))
    text.joint("rocker", "base", xyz=(0.4, 0, 0), rpy=(pi / 2, 0, 0), axis=(0, 0, -1))
    text.joint("tip", "coupler", xyz=(0.4, 0, 0), kind="fixed")
    text.joint("pin", "rocker", xyz=(0.3, 0, 0), rpy=(-pi / 2, 0, 0), kind="fixed")
    return text


def four_bar(folder, digits=EXACT, kind="hinge", **options):
    """A four-bar in x-z whose rocker's pivot is turned by pi/2."""
    text = four_links(digits)
    posture = {"crank": -1.0, "coupler": 0.75, "rocker": -1.25}
    robot = text.robot(folder, posture, **options)
    return cp.Scene(
        robot, [cp.Loop("l_tip", "l_pin", kind, axis=axis_of(kind, "y"), name="tip~pin")]
    )


def bennett(folder, digits=EXACT, **options):
    """Bennett's linkage: four skew hinges that move by their twists alone."""
    a, b, alpha = 0.5, 0.8, 0.5
    beta = asin(b * sin(alpha) / a)
    text = Description(digits)
    text.joint("one", "base")
    text.joint("two", "one", xyz=(a, 0, 0), rpy=(alpha, 0, 0))
    text.joint("three", "two", xyz=(b, 0, 0), rpy=(beta, 0, 0))
    text.joint("end", "three", xyz=(a, 0, 0), rpy=(alpha, 0, 0), kind="fixed")
    # the ground link the other way round: R_x(-beta), then -b along x
    text.joint("bearing", "base", xyz=(-b, 0, 0), rpy=(-beta, 0, 0), kind="fixed")
    K = sin((beta + alpha) / 2) / sin((beta - alpha) / 2)
    posture = {"one": 1.2, "two": 2 * atan(K / tan(0.6)), "three": -1.2}
    robot = text.robot(folder, posture, **options)
    return cp.Scene(robot, [cp.Loop("l_end", "l_bearing", "hinge", axis="z", name="closure")])


def sarrus(folder, digits=EXACT, **options):
    """Sarrus' linkage: two legs of three parallel hinges, square to each other, lift a plate."""
    text = Description(digits)
    text.joint("a1", "base", xyz=(0.3, 0, 0), rpy=(-pi / 2, 0, 0))
    text.joint("a2", "a1", xyz=(0.5, 0, 0), rpy=(0, pi / 2, 0), axis=(-1, 0, 0))
    text.joint("a3", "a2", xyz=(0, 0, 0.5), rpy=(0, -pi / 2, 0))
    text.joint("b1", "base", xyz=(0, 0.3, 0), rpy=(-pi / 2, 0, pi / 2))
    text.joint("b2", "b1", xyz=(0.5, 0, 0))
    # the plate is on leg a; its hinge of leg b has b3's axis
    text.joint("upper", "a3", xyz=(-0.3, 0, 0), rpy=(pi / 2, 0, 0), kind="fixed")
    text.joint("plate", "upper", xyz=(0, 0.3, 0), rpy=(-pi / 2, 0, pi / 2), kind="fixed")
    text.joint("tip", "b2", xyz=(0.5, 0, 0), kind="fixed")
    posture = {"a1": -0.6, "a2": -1.94, "a3": 2.54, "b1": -0.6, "b2": -1.94}
    robot = text.robot(folder, posture, **options)
    return cp.Scene(robot, [cp.Loop("l_plate", "l_tip", "hinge", axis="z", name="plate~tip")])


def two_loops(folder, digits=EXACT, kind="ball", **options):
    """A six-bar in a plane: a dyad on the rocker of a four-bar, its pivots turned by pi/2."""
    text = four_links(digits)
    text.joint("link", "rocker", xyz=(0.15, 0, 0), rpy=(-pi / 2, 0, 0), axis=(0, 1, 0))
    text.joint("arm", "base", xyz=(0.8, 0, 0), rpy=(pi / 2, 0, 0), axis=(0, 0, -1))
    text.joint("hand", "link", xyz=(0.35, 0, 0), kind="fixed")
    text.joint("eye", "arm", xyz=(0.25, 0, 0), rpy=(-pi / 2, 0, 0), kind="fixed")
    posture = {"crank": -1.0, "coupler": 0.72, "rocker": -1.27, "link": 1.45, "arm": -1.6}
    robot = text.robot(folder, posture, **options)
    loops = [
        cp.Loop("l_tip", "l_pin", kind, axis=axis_of(kind, "y")),
        cp.Loop("l_hand", "l_eye", kind, axis=axis_of(kind, "y")),
    ]
    return cp.Scene(robot, loops)


MJCF = """<mujoco><compiler angle="radian"/><worldbody>
<body name="ab" pos="0 0 0"><joint name="A" axis="0 1 0"/><inertial pos=".2 .01 0" mass="1"
diaginertia=".01 .02 .02"/><body name="bc" pos=".4 0 0"><joint name="B" axis="0 1 0"/>
<inertial pos=".3 0 .02" mass="1.2" diaginertia=".01 .02 .02"/>{end}</body></body>
<body name="cd" pos=".7 0 0" euler="{right} 0 0"><joint name="D" axis="0 0 -1"/>
<inertial pos=".25 0 0" mass="1" diaginertia=".01 .02 .02"/></body></worldbody>
<equality>{tie}</equality><keyframe><key qpos="{qpos}"/></keyframe></mujoco>"""
TIES = {
    "connect": ("", '<connect body1="bc" body2="cd" anchor="0.6 0 0"/>', "-1.1 0.75 -1.25"),
    "weld": (
        """<body name="end" pos=".6 0 0"><joint name="C" axis="0 1 0"/><inertial pos="0 .05 0"
mass=".2" diaginertia="1e-3 1e-3 1e-3"/></body>""",
        '<weld body1="end" body2="cd" anchor="0.5 0 0"/>',
        "-1.1 0.75 -0.9 -1.25",
    ),
}


def mjcf(folder, digits=EXACT, tie="connect", **options):
    """A four-bar of MuJoCo's, closed at a point or welded behind its last hinge."""
    end, text, qpos = TIES[tie]
    path = folder / f"{tie}_{digits}.xml"
    path.write_text(MJCF.format(end=end, tie=text, qpos=qpos, right=round(pi / 2, digits)))
    robot = cp.load_robot(path, **options)
    return cp.Scene(robot, robot.loops)


def sdf(folder, digits=EXACT, **options):
    """A parallelogram whose fourth joint closes it; the pose of one pivot is turned by pi/2."""
    inertial = (
        "<inertial><pose>0.2 0 0 0 0 0</pose><mass>1</mass><inertia><ixx>.01</ixx><iyy>.02</iyy>"
        "<izz>.02</izz><ixy>0</ixy><ixz>0</ixz><iyz>0</iyz></inertia></inertial>"
    )
    x, z = 0.4 * np.cos(1.2), 0.4 * np.sin(1.2)
    links = {"ab": "0 0 0 0 -1.2 0", "bc": f"{x:.17g} 0 {z:.17g} 0 0 0", "cd": "0.6 0 0 0 -1.2 0"}
    joints = (
        ("A", "0 0 0 0 0 0", "world", "ab", "0 1 0"),
        ("B", "0 0 0 0 0 0", "ab", "bc", "0 1 0"),
        ("D", f"0 0 0 {round(pi / 2, digits)!r} 0 0", "world", "cd", "0 0 -1"),
        ("C", "0.4 0 0 0 0 0", "cd", "bc", "0 1 0"),
    )
    text = "".join(
        f"<link name='{name}'><pose>{pose}</pose>{inertial}</link>" for name, pose in links.items()
    ) + "".join(
        f"<joint name='{name}' type='revolute'><pose>{pose}</pose><parent>{parent}</parent>"
        f"<child>{child}</child><axis><xyz>{axis}</xyz></axis></joint>"
        for name, pose, parent, child, axis in joints
    )
    path = folder / f"bar_{digits}.sdf"
    path.write_text(f"<sdf version='1.9'><model name='bar'>{text}</model></sdf>")
    robot = cp.load_robot(path, **options)
    return cp.Scene(robot, robot.loops)


MACHINES = {
    "hinge": (four_bar, 2),
    "ball": (lambda *a, **o: four_bar(*a, kind="ball", **o), 2),
    "bennett": (bennett, 2),
    "sarrus": (sarrus, 4),
    "two balls": (two_loops, 4),
    "two hinges": (lambda *a, **o: two_loops(*a, kind="hinge", **o), 4),
    "connect": (mjcf, 2),
    "weld": (lambda *a, **o: mjcf(*a, tie="weld", **o), 3),
    "sdf": (sdf, 2),
}
machines = pytest.mark.parametrize("name", MACHINES)


def both(name, folder, digits=4):
    """A machine with all digits and with few, and its rank; 4 digits of pi/2 are 1.5708."""
    make, rank = MACHINES[name]
    return make(folder), make(folder, digits), rank


def answers(scene):
    """The acceleration of a scene that moves, at its nominal state."""
    q, _ = scene.state()
    n = scene.robot.nv
    v = mechanism.project_velocity(scene, q, np.ones(n))
    return cp.solve(scene, q, v, np.linspace(0.1, 0.5, n))


@machines
def test_machines_move_as_with_all_digits(name, tmp_path):
    exact, rounded, rank = both(name, tmp_path)
    right, found = answers(exact), answers(rounded)
    assert exact.nominal.rank == rounded.nominal.rank == found.rank == rank
    assert rounded.nominal.mobility == 1
    assert rounded.nominal.dependent
    assert rounded.rank().rank == rounded.rank().generic_rank == rank
    assert rounded.summary().mobility == 1
    assert found.status.ok
    assert found.doubt < 1e-4
    assert len(found.left_out) == rounded.rows - rank
    np.testing.assert_allclose(found.a, right.a, rtol=1e-3, atol=1e-3 * np.abs(right.a).max())


@machines
def test_states_are_closed_but_for_what_digits_leave_open(name, tmp_path):
    _, scene, _ = both(name, tmp_path)
    q, v = scene.sample(np.random.default_rng(1))
    check, assembly, rank = scene.check(q, v), scene.assemble(q), scene.rank(q)
    assert check.ok
    assert assembly.status.ok
    assert assembly.closed
    assert rank.closed
    for violation in (check.violation, assembly.violation, rank.violation):
        assert 1e-10 < max(gap.size for gap in violation.values()) < 1e-5
    for to_close in (check.to_close, assembly.to_close, rank.to_close):
        assert max(gap.size for gap in to_close.values()) <= 1e-10
    assert not rank.conflict
    assert not rank.singular
    a = mechanism.project_acceleration(scene, q, v, np.ones(scene.robot.nv))
    assert np.isfinite(a).all()


@machines
def test_notices_name_loop_and_cure(name, tmp_path):
    exact, scene, rank = both(name, tmp_path)
    texts = answers(scene).notices, scene.summary().notes, scene.rank().notes
    for notes in texts:
        (note,) = [text for text in notes if "precision=0" in text]
        assert f"rank {rank} of {scene.rows}, mobility 1" in note
        assert all(constraint.name in note for constraint in scene.constraints)
        assert "1.5708 for pi/2?" in note or name == "bennett"
        assert ("kind='planar'" in note) == (name not in ("bennett", "sarrus", "weld"))
    assert not any(
        "precision" in text for text in (*exact.summary().notes, *answers(exact).notices)
    )


@pytest.mark.long
@pytest.mark.parametrize("digits", [4, 5, 6])
def test_twists_of_bennett_with_some_digits(digits, tmp_path):
    right = answers(bennett(tmp_path)).a
    scene = bennett(tmp_path, digits)
    assert scene.nominal.rank == 2
    np.testing.assert_allclose(answers(scene).a, right, rtol=10.0 ** (2 - digits))


@pytest.mark.long
def test_axes_that_are_off_are_named(tmp_path):
    (note,) = [text for text in four_bar(tmp_path, 4).rank().notes if "axes" in text]
    assert note == (
        "loop 'tip~pin' (hinge): axes of 'coupler' and 'rocker' are off parallel by 3.7e-6 rad "
        "(1.5708 for pi/2?); taken as parallel: rank 2 of 5, mobility 1. Use kind='planar', write "
        "all digits, or precision=0"
    )


@pytest.mark.parametrize("name", ["hinge", "ball", "bennett", "sarrus"])
def test_every_method_leaves_out_the_same_rows(name, tmp_path):
    _, scene, _ = both(name, tmp_path)
    q, v = scene.sample(np.random.default_rng(2))
    tau = np.linspace(0.1, 0.5, scene.robot.nv)
    right = cp.solve(scene, q, v, tau, solver=dynamics.Reference())
    solvers = [cp.Proximal(), dynamics.NullSpace(), dynamics.GaussPrinciple()]
    if pin.PINOCCHIO_MAJOR_VERSION > 3:
        solvers.append(cp.LCABA())
    for solver in solvers:
        found = cp.solve(scene, q, v, tau, solver=solver)
        np.testing.assert_allclose(found.a, right.a, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(found.lam, right.lam, rtol=1e-7, atol=1e-7)
        hot = cp.Workspace(scene, solver).acceleration(q, v, tau)
        np.testing.assert_allclose(hot, right.a, rtol=1e-4, atol=1e-4)
    batch = cp.solve_batch(scene, np.array([q, q]), np.array([v, v]), tau)
    np.testing.assert_allclose(batch.a, [right.a, right.a], rtol=1e-9, atol=1e-9)


@pytest.mark.values
@pytest.mark.parametrize(
    "integrator",
    [
        None, simulation.CoordinatePartitioning(), simulation.GearGuptaLeimkuhler(),
        simulation.GeneralisedAlpha(), simulation.RadauIIA(), simulation.Rattle(),
        simulation.Shake(),
    ],
    ids=lambda integrator: type(integrator).__name__,
)  # fmt: skip
@pytest.mark.parametrize("name", ["ball", "bennett"])
def test_motions_are_those_of_all_digits(name, integrator, tmp_path):
    exact, rounded, _ = both(name, tmp_path)
    ends = []
    for scene in (exact, rounded):
        q, v = scene.state()
        motion = cp.simulate(scene, q, v, duration=0.05, dt=1e-3, integrator=integrator)
        ends.append(np.concatenate([motion.q[-1], motion.v[-1]]))
        assert motion.status.ok, motion.reason
    np.testing.assert_allclose(ends[1], ends[0], rtol=1e-4, atol=2e-5)


@pytest.mark.long
def test_a_held_joint_leaves_the_others_to_close(tmp_path):
    exact, rounded, _ = both("hinge", tmp_path)
    for scene in (exact, rounded):
        q = scene.robot.configuration({"crank": -0.8, "coupler": 0.6, "rocker": -1.2})
        found = scene.assemble(q, fixed=["crank"])
        assert found.closed
        assert found.rank == 2
        assert scene.robot.joint_values(found.q)["crank"] == -0.8


@pytest.mark.long
def test_precision_0_takes_files_at_their_word(tmp_path):
    scene = four_bar(tmp_path, 4, kind="ball", precision=0)
    assert scene.robot.precision == 0.0
    assert scene.nominal.digits is None
    hinge = four_bar(tmp_path, 4, precision=0)
    assert not hinge.assemble(hinge.robot.postures["drawn"], throw=False).closed


@pytest.mark.long
def test_axes_far_from_parallel_are_believed_and_told(tmp_path):
    for kind in ("hinge", "ball"):
        scene = four_bar(tmp_path, 2, kind=kind)  # 1.57
        note = scene.nominal.digits.note
        assert "'coupler' and 'rocker' are off parallel by 0.0008 rad (1.57 for pi/2?)" in note
        assert "1 of 1 freedoms is lost" in note
        assert "precision=1e-3" in note
        found = scene.assemble(scene.robot.postures["drawn"], throw=False)
        assert found.closed or "off parallel" in str(found.error())
        assert any("off parallel" in text for text in scene.rank().notes)
        meant = cp.Scene(replace(scene.robot, precision=1e-3), scene.constraints)
        assert meant.nominal.rank == 2
        assert meant.nominal.mobility == 1


def test_a_linkage_a_little_off_its_plane():
    bar = cp.load_robot("four_bar").with_frame("beside", "coupler_tip", [0, 1e-9, 0])
    loop = cp.Loop("beside", "rocker_tip", "ball")
    with pytest.raises(errors.NotAssembled, match="closes but for 1 nm across its plane"):
        cp.Scene(bar, [loop]).state()
    scene = cp.Scene(replace(bar, precision=1e-8), [loop])
    plane = cp.Scene(bar, bar.loops)
    np.testing.assert_allclose(
        cp.solve(scene, *scene.state(), np.zeros(3)).a,
        cp.solve(plane, *plane.state(), np.zeros(3)).a,
        rtol=1e-6,
    )
    assert "taken as in the plane: rank 2 of 3" in scene.nominal.digits.note


@pytest.mark.long
@each_row("name", ["parallelogram", "bricard", "cassie", "delta", "five_bar"])
def test_machines_with_all_digits_are_not_looked_at(name):
    robot = cp.load_robot(name)
    assert cp.Scene(replace(robot, precision=1e-5), robot.loops).nominal.digits is None


@pytest.mark.long
def test_a_dead_point_is_no_digit(tmp_path):
    robot = cp.load_robot("parallelogram")
    flat = replace(robot, precision=1e-5, postures={"flat": 1e-6 * np.array([1.0, -1.0, 1.0])})
    scene = cp.Scene(flat, robot.loops)
    assert scene.nominal.digits is None


@pytest.mark.long
def test_files_have_five_digits_and_models_all(tmp_path):
    scene = four_bar(tmp_path, 4)
    robot = scene.robot
    assert robot.precision == 1e-5
    assert cp.load_robot("cassie").precision == 1e-5
    assert cp.load_robot("four_bar").precision == 1e-11
    assert cp.load_robot("four_bar", precision=1e-6).precision == 1e-6
    for derived in (
        robot.with_frame("more", "base", [0, 0, 1]),
        robot.with_masses({"crank": 2.0}),
        replace(robot, name="other"),
        pickle.loads(pickle.dumps(robot)),
        scene.lock(["crank"]).robot,
        cp.model.together({"a": robot, "b": cp.load_robot("four_bar")}),
    ):
        assert derived.precision == 1e-5
    assert replace(robot, precision=0.0) != robot
    (tmp_path / "robot.toml").write_text(
        'name = "bar"\nprecision = 1e-4\n[description]\nfile = "written_4.urdf"\n'
    )
    assert cp.load_robot(tmp_path).precision == 1e-4
    assert cp.load_robot(tmp_path, precision=0).precision == 0.0


@pytest.mark.parametrize("precision", [-1e-9, 2e-3, np.nan, "fine"])
def test_a_precision_is_a_small_number(precision):
    with pytest.raises(errors.InvalidArgument, match="precision"):
        cp.load_robot("four_bar", precision=precision)


@pytest.mark.long
def test_a_motion_file_keeps_the_precision(tmp_path):
    scene = four_bar(tmp_path, 4, kind="ball")
    motion = cp.simulate(scene, *scene.state(), duration=0.002, dt=1e-3)
    motion.save(tmp_path / "motion.npz")
    assert cp.Trajectory.load(tmp_path / "motion.npz").scene.robot.precision == 1e-5
