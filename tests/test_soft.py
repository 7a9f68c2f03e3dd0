"""Soft constraints against MuJoCo's own accelerations, gap, slip and all."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from referee import MujocoReferee
from shared import SOLVED, all_scenes, each_row, each_scene, relative, robot, states

import condyn_pin as cp

# Two engines and their rounding; measured 2e-12 at worst, on Cassie.
AGREES = 1e-11

# Before version 4 MuJoCo left Jdot v out.
MOVING = [0.0, 1.0] if int(mujoco.__version__.split(".")[0]) >= 4 else [0.0]

STIFF = cp.dynamics.Soft(solref=(0.005, 0.7), solimp=(0.5, 0.99, 0.05, 0.3, 3.0))
DIRECT = cp.dynamics.Soft(solref=(-900.0, -40.0), solimp=(0.8, 0.8, 0.01, 0.5, 1.0))
each_soft = pytest.mark.parametrize(
    "soft", [cp.dynamics.Soft(), STIFF, DIRECT], ids=["0", "1", "2"]
)


def loops_alone(label: str) -> cp.Scene:
    """Return the scene with its loops between moving bodies: MuJoCo has no contacts like ours."""
    scene = all_scenes()[label]
    pairs = zip(scene.constraints, scene.bounds, strict=True)
    return cp.Scene(scene.robot, [made for made, bound in pairs if bound.joint2])


def mujoco_acceleration(scene: cp.Scene, soft: cp.dynamics.Soft, q, v, tau) -> np.ndarray:
    """Return `qacc` of the exported scene in Pinocchio's coordinates."""
    referee = MujocoReferee(replace(scene.robot, loops=scene.constraints))
    model, data = referee._mj, referee.data
    X, Xdot_v = referee._place(q, v)
    ask_as(model, soft)
    data.qfrc_applied[:] = np.linalg.solve(X.T, tau)
    mujoco.mj_forward(model, data)
    return np.linalg.solve(X, data.qacc - Xdot_v)


def ask_as(model: mujoco.MjModel, soft: cp.dynamics.Soft) -> None:
    """Give MuJoCo the parameters of a soft solver, and time to converge."""
    model.eq_solref[:], model.eq_solimp[:] = soft.solref, soft.solimp
    model.opt.timestep, model.opt.tolerance, model.opt.iterations = 1e-4, 0.0, 100
    # what a solve leaves out, unless it is put into tau
    model.dof_damping[:], model.dof_frictionloss[:], model.jnt_stiffness[:] = 0.0, 0.0, 0.0
    model.jnt_limited[:] = False


@pytest.mark.pairs
@each_soft
@pytest.mark.parametrize("moving", MOVING)
@pytest.mark.parametrize("label", ["four_bar loops", "cassie loops", "talos foot to foot, welded"])
def test_closed_states_accelerate_as_in_mujoco(label, moving, soft):
    scene = loops_alone(label)
    for q, v, tau in states(label):
        found = cp.solve(scene, q, moving * v, tau, solver=soft, throw=False)
        assert relative(found.a, mujoco_acceleration(scene, soft, q, moving * v, tau)) < AGREES


@pytest.mark.pairs
@each_soft
@pytest.mark.parametrize("gap", [1e-4, 1e-2, 1.0])
@pytest.mark.parametrize("label", ["four_bar loops", "cassie loops"])
def test_open_and_sliding_balls_close_as_in_mujoco(label, gap, soft):
    """c and J v are not zero: impedance, stiffness and damping all count."""
    scene, rng = loops_alone(label), np.random.default_rng(3)
    for q, v, tau in states(label):
        open_q = pin.integrate(scene.robot.model, q, gap * rng.normal(size=v.size))
        sliding = MOVING[-1] * (v + gap * rng.normal(size=v.size))
        found = cp.solve(scene, open_q, sliding, tau, solver=soft, throw=False)
        assert np.abs(cp.Workspace(scene).violation(open_q)).max() > 1e-2 * gap
        expected = mujoco_acceleration(scene, soft, open_q, sliding, tau)
        assert relative(found.a, expected) < AGREES


@each_soft
def test_a_coupling_gives_way_as_in_mujoco(soft):
    bar = robot("four_bar")
    ratio, offset = -0.5, 0.7
    scene = cp.Scene(bar, [cp.constraints.Coupling("rocker", "crank", ratio, offset)])
    text = replace(bar, loops=scene.constraints).to_mjcf()
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    ask_as(model, soft)
    rng = np.random.default_rng(0)
    for _ in range(5):
        q, v, tau = rng.normal(size=(3, 3))
        data.qpos[:], data.qvel[:], data.qfrc_applied[:] = q, v, tau
        mujoco.mj_forward(model, data)
        found = cp.solve(scene, q, v, tau, solver=soft, throw=False)
        assert np.abs(found.state_error.position) > 1e-3
        assert relative(found.a, data.qacc) < AGREES


_FILE = """<mujoco><compiler angle="{unit}"/><worldbody>
<body name="base" pos="0 0 1">{root}
 <inertial pos="0.05 0.02 -0.1" mass="3" diaginertia="0.02 0.03 0.04"/>
 <body name="a" pos="0.3 0 0" quat="0.9 0.1 0.2 0.05">{one}
  <inertial pos="0.05 0.02 -0.1" mass="1" diaginertia="0.02 0.03 0.04"/>
  <body name="b" pos="0 0.1 -0.4">{two}
   <inertial pos="0.05 0.02 -0.1" mass="0.7" diaginertia="0.02 0.03 0.04"/>
   <site name="s1" pos="0 0 -0.3"/></body></body>
 <body name="c" pos="-0.2 0 0">
  <joint name="three" axis="0 1 0.3" ref="0.1" pos="0.1 0 0.1"/>
  <inertial pos="0.05 0.02 -0.1" mass="1.3" diaginertia="0.02 0.03 0.04"/>
  <site name="s2" pos="0 0.1 -0.5"/></body>
</body></worldbody><equality>{equality}</equality>{keyframe}</mujoco>"""
_CONNECT = '<connect name="loop" site1="s1" site2="s2"/>'
_DRAWN = {
    "hinges": {"one": '<joint name="one" axis="0 1 0" ref="0.7"/>'},
    "degrees": {"one": '<joint name="one" axis="0 1 0" ref="40"/>', "unit": "degree"},
    "slide": {"two": '<joint name="two" type="slide" axis="1 0 0" ref="-0.6"/>'},
    "springs": {
        "one": '<joint name="one" axis="0 1 0" springref="0.7" stiffness="3" ref="-0.3"/>',
        "two": '<joint name="two" type="slide" axis="1 0 0" springref="-0.6" stiffness="7"/>',
    },
    "free": {"root": '<freejoint name="root"/>'},
    "ball": {"root": '<freejoint name="root"/>', "one": '<joint name="one" type="ball"/>'},
    "gear": {"equality": '<joint name="gear" joint1="one" joint2="three" polycoef="0.1 2 0 0 0"/>'},
    "keyframe": {"keyframe": '<keyframe><key name="qpos0" qpos="0 .1 .2 .1"/></keyframe>'},
}


@pytest.mark.values
@pytest.mark.parametrize("exported", [False, True], ids=["the file", "exported"])
@pytest.mark.parametrize("drawn", _DRAWN.values(), ids=_DRAWN)
def test_weights_are_those_of_the_pose_in_which_the_file_is_drawn(drawn, exported, tmp_path):
    """A `ref` draws a model away from zero, and there MuJoCo takes its inverse inertias."""
    plain = {
        "unit": "radian", "root": '<joint name="root" axis="0 1 0"/>', "keyframe": "",
        "one": '<joint name="one" axis="0 1 0" ref="0.7"/>', "equality": _CONNECT,
        "two": '<joint name="two" axis="1 0 0" ref="-1.1" pos="0 0.1 0"/>',
    }  # fmt: skip
    file = tmp_path / "drawn.xml"
    file.write_text(_FILE.format(**plain | drawn))
    robot = cp.load_robot(file)
    text = robot.to_mjcf() if exported else file.read_text()
    model = mujoco.MjModel.from_xml_string(text)
    bridge = cp.study.MujocoBridge(robot, model)
    expected, _ = bridge.from_mujoco(model.qpos0, np.zeros(model.nv))
    assert np.allclose(robot.postures["qpos0"], expected, atol=1e-12)
    soft, data, rng = cp.dynamics.Soft(), mujoco.MjData(model), np.random.default_rng(0)
    ask_as(model, soft)
    for _ in range(3):
        q = pin.integrate(robot.model, expected, 0.5 * rng.normal(size=robot.nv))
        v, tau = MOVING[-1] * rng.normal(size=robot.nv), rng.normal(size=robot.nv)
        data.qpos[:], data.qvel[:] = bridge.to_mujoco(q, v)
        data.qfrc_applied[:] = bridge.torque_to_mujoco(q, tau)
        mujoco.mj_forward(model, data)
        a = bridge.acceleration_from_mujoco(q, v, data.qacc)
        found = cp.solve(cp.Scene(robot, robot.loops), q, v, tau, solver=soft, throw=False)
        assert relative(found.a, a) < AGREES


@pytest.mark.long
def test_impedance_rises_from_one_end_to_the_other():
    soft = cp.dynamics.Soft(solimp=(0.2, 0.9, 0.01, 0.4, 3.0))
    gaps = np.linspace(0.0, 0.02, 401)
    d = soft.impedance(gaps)
    assert d[0] == 0.2
    assert np.allclose(d[gaps >= 0.01], 0.9)
    assert (np.diff(d) >= 0).all()
    assert soft.impedance(np.array([0.004]))[0] == pytest.approx(0.2 + 0.7 * 0.4)


def test_the_dynamics_hold_and_the_status_says_what_does_not():
    """The answer is judged as every other; who asks for less gets it as ok."""
    scene, state = all_scenes()["talos contacts"], states("talos contacts")[0]
    soft = cp.solve(scene, *state, solver=cp.dynamics.Soft(), throw=False)
    assert soft.status is cp.Status.INACCURATE
    assert soft.dynamics_error < 1e-11 * scene.nominal.weight
    assert soft.constraint_error > 1e-3
    hard = cp.solve(scene, *state, solver=cp.dynamics.Reference())
    error = relative(soft.a, hard.a)
    assert SOLVED < error < soft.error_bound
    with pytest.raises(cp.SolveFailed, match="inaccurate"):
        cp.solve(scene, *state, solver=cp.dynamics.Soft())
    assert cp.solve(
        scene, *state, solver=cp.dynamics.Soft(), accuracy=2 * soft.error_bound
    ).status.ok


@pytest.mark.long
def test_redundant_rows_share_the_load():
    """A foot held twice: half of the force each."""
    label = "talos foot held twice"
    found = cp.solve(all_scenes()[label], *states(label)[0], solver=cp.dynamics.Soft(), throw=False)
    once, again = found.forces["left_sole_link"], found.forces["again"]
    assert np.allclose(once, again, rtol=1e-9, atol=1e-9 * np.abs(once).max())


def opened(scene: cp.Scene, state, size=1e-3):
    """A state whose constraints are open, and slip."""
    rng, (q, v, tau) = np.random.default_rng(4), state
    away = size * rng.normal(size=scene.robot.nv)
    return pin.integrate(scene.robot.model, q, away), v + away, tau


@each_scene
def test_derivatives_are_those_of_differences(label):
    """Also where constraints are open: impedance, and with it R and k, change with the gap."""
    scene, softs = all_scenes()[label], (cp.dynamics.Soft(), STIFF, DIRECT)
    soft = softs[[*all_scenes()].index(label) % 3]
    state = opened(scene, states(label)[0])
    exact = cp.derivatives(scene, *state, solver=soft)
    wanted = cp.derivatives(scene, *state, solver=soft, method="differences")
    for name in ("da_dq", "da_dv", "da_dtau", "dlam_dq", "dlam_dv", "dlam_dtau"):
        had, numeric = getattr(exact, name), getattr(wanted, name)
        if numeric.size:
            assert np.abs(had - numeric).max() <= 1e-6 * max(np.abs(numeric).max(), 1.0), name


@each_soft
@pytest.mark.parametrize("label", ["solo12 contacts", "cassie loops"])
def test_derivatives_by_solref(label, soft):
    scene = all_scenes()[label]
    state = opened(scene, states(label)[0])
    a, lam = cp.derivatives(scene, *state, solver=soft).by_solref()
    for i, x in enumerate(soft.solref):

        def answer(h, i=i, x=x):
            solref = [x * (1 + h) if j == i else y for j, y in enumerate(soft.solref)]
            found = cp.solve(scene, *state, solver=replace(soft, solref=solref), throw=False)
            return np.concatenate((found.a, found.lam))

        h = 1e-3
        wanted = 8 * (answer(h) - answer(-h)) - (answer(2 * h) - answer(-2 * h))
        wanted = wanted / (12 * h * x)
        error = np.abs(np.concatenate((a[:, i], lam[:, i])) - wanted).max()
        assert error <= 1e-8 * np.abs(wanted).max()


def test_derivatives_by_gravity_and_along():
    scene, soft = all_scenes()["cassie loops"], STIFF
    state = opened(scene, states("cassie loops")[0])
    of = cp.derivatives(scene, *state, solver=soft, check=True)
    x = np.random.default_rng(0).normal(size=(3, scene.robot.nv))
    a, lam = of.jvp(*x)
    y, z = np.random.default_rng(1).normal(size=len(a)), np.ones(len(lam))
    assert np.isclose(y @ a + z @ lam, sum(map(np.dot, of.vjp(y, z), x)), rtol=1e-10)
    by_g = of.by_gravity()[0][:, 2]

    def lifted(h):
        model = pin.Model(scene.robot.model)
        model.gravity = pin.Motion(np.array([0.0, 0.0, -9.81 + h]), np.zeros(3))
        there = replace(scene, robot=replace(scene.robot, model=model))
        return cp.solve(there, *state, solver=soft, throw=False).a

    wanted = (lifted(1.0) - lifted(-1.0)) / 2  # a is linear in gravity
    assert np.allclose(by_g, wanted, atol=1e-9 * np.abs(wanted).max())


@each_soft
@pytest.mark.parametrize("label", ["solo12 contacts", "cassie loops", "four_bar geared"])
def test_derivatives_by_inertias(label, soft):
    """Of random ones; R goes with what bodies give way to, and so with what they weigh."""
    scene, rng = all_scenes()[label], np.random.default_rng(2)
    state = opened(scene, states(label)[0])
    a, lam = cp.derivatives(scene, *state, solver=soft).by_inertias()
    own = [Y.toDynamicParameters() for Y in list(scene.robot.model.inertias)[1:]]
    step = [pi * rng.uniform() for pi in own]
    for pi in step:
        pi[1:4] += 0.1 * pi[0] * rng.uniform(-0.1, 0.1, 3)  # centres move too

    def heavier(h):
        model = pin.Model(scene.robot.model)
        for i, (pi, by) in enumerate(zip(own, step, strict=True), start=1):
            if pi[0]:
                model.inertias[i] = pin.Inertia.FromDynamicParameters(pi + h * by)
        there = replace(scene, robot=replace(scene.robot, model=model))
        found = cp.solve(there, *state, solver=soft, throw=False)
        return np.concatenate((found.a, found.lam))

    h = 1e-3
    wanted = 8 * (heavier(h) - heavier(-h)) - (heavier(2 * h) - heavier(-2 * h))
    wanted /= 12 * h
    x = np.concatenate(step)
    assert np.abs(np.concatenate((a @ x, lam @ x)) - wanted).max() <= 1e-7 * np.abs(wanted).max()


@pytest.mark.long
def test_what_gives_way_has_none_of_pinocchio():
    scene, state = all_scenes()["solo12 contacts"], states("solo12 contacts")[0]
    with pytest.raises(cp.InvalidArgument, match=r"Proximal"):
        cp.derivatives(scene, *state, solver=cp.dynamics.Soft(), method="pinocchio")


@each_row(
    "parameters",
    [
        {"solref": (0.0, 1.0)},
        {"solref": (0.02, -1.0)},
        {"solref": (0.02,)},
        {"solref": (np.nan, 1.0)},
        {"solimp": (0.0, 0.95, 0.001, 0.5, 2.0)},
        {"solimp": (0.9, 1.0, 0.001, 0.5, 2.0)},
        {"solimp": (0.9, 0.95, 0.0, 0.5, 2.0)},
        {"solimp": (0.9, 0.95, 0.001, 1.0, 2.0)},
        {"solimp": (0.9, 0.95, 0.001, 0.5, 0.5)},
        {"solimp": (0.9, 0.95)},
    ],
)
def test_knobs_that_mean_nothing_are_refused(parameters):
    with pytest.raises(cp.InvalidArgument, match=next(iter(parameters))):
        cp.dynamics.Soft(**parameters)


@pytest.mark.long
def test_lists_are_knobs_too():
    assert (
        cp.dynamics.Soft(solref=[0.02, 1], solimp=[0.9, 0.95, 0.001, 0.5, 2]) == cp.dynamics.Soft()
    )
    assert hash(cp.dynamics.Soft(solref=[0.02, 1])) == hash(cp.dynamics.Soft())


@pytest.mark.long
def test_a_robot_of_a_single_joint():
    """Pinocchio hands out the one column of its Jacobian as a vector."""
    pendulum = cp.model.pendulum()
    scene = cp.Scene(pendulum, [cp.PointContact(pendulum.frames[-1])])
    held = cp.solve(scene, [0.7], [0.0], [0.0], solver=cp.dynamics.Soft(), throw=False)
    free = cp.solve(cp.Scene(pendulum), [0.7], [0.0], [0.0])
    assert 0 < np.abs(held.a).max() < 0.2 * np.abs(free.a).max()
