"""The files of the robots, read by MuJoCo itself: the same M, the same bias, the same loops.

`test_mujoco.py` gives MuJoCo the tree that Pinocchio made of a file; here it makes its own. Joints
are matched by name, for both engines sort them in their own way.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from shared import robot

import condyn_pin as cp
from condyn_pin.io.load import example_robot_data, robots_folder

AGREES = 1e-10  # measured: 1e-13
SEEDS = (0, 1, 2)

# Robots that MuJoCo cannot read, each with its reason, and for a file what MuJoCo says to it.
UNREADABLE = {
    "cassie": "an SDF: MuJoCo reads none",
    "chain": "built without a file",
    "four_bar": "built without a file",
    "n_four_bar": "built without a file",
    "pendulum": "built without a file",
    "sleigh": "built without a file",
    "unicycle": "built without a file",
    "rolling_disc": "built without a file",
    "rolling_ball": "built without a file",
}
REFUSED = {
    "anymal_c": "inertia must satisfy A \\+ B >= C",  # its cameras, see robots/anymal_c/README.md
    "hyq": "inertia must (have positive eigenvalues|satisfy A \\+ B >= C)",  # its feet
}


def description(name: str) -> Path:
    """Return the file of a robot's description."""
    folder = robots_folder() / name
    card = tomllib.loads((folder / "robot.toml").read_text(encoding="utf-8"))
    file = card["description"]["file"]
    beside = folder / file
    return beside if beside.is_file() else example_robot_data() / file


FILES = {
    name: description(name)
    for name in cp.available_robots()
    if name not in UNREADABLE and name not in REFUSED
}
MECHANISMS = [name for name, file in FILES.items() if file.suffix == ".xml"]


def read(file: Path, model: pin.Model) -> mujoco.MjModel:
    """Let MuJoCo read a file as it stands; a URDF without shapes, and with its floating base."""
    if file.suffix == ".xml":
        made = mujoco.MjModel.from_xml_path(str(file))
    else:
        floating = model.joints[1].nq == 7
        made = mujoco.MjModel.from_xml_string(bare_urdf(file, floating=floating))
    made.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    for joint, there in matched(model, made):
        if joint.nv == 1:  # rotors are in the SRDF
            made.dof_armature[there.dofadr[0]] = model.armature[joint.idx_v]
    return made


def bare_urdf(file: Path, *, floating: bool) -> str:
    root = ElementTree.parse(file).getroot()
    for element in [root, *root.iter("link")]:
        for tag in ("visual", "collision", "transmission", "gazebo", "mujoco"):
            for part in element.findall(tag):
                element.remove(part)
    settings = {"fusestatic": "true", "balanceinertia": "false", "inertiafromgeom": "false"}
    ElementTree.SubElement(ElementTree.SubElement(root, "mujoco"), "compiler", settings)
    if floating:
        children = {joint.find("child").get("link") for joint in root.findall("joint")}
        (base,) = (x.get("name") for x in root.findall("link") if x.get("name") not in children)
        ElementTree.SubElement(root, "link", name="the_world")
        joint = ElementTree.SubElement(root, "joint", name="root_joint", type="floating")
        ElementTree.SubElement(joint, "parent", link="the_world")
        ElementTree.SubElement(joint, "child", link=base)
    return ElementTree.tostring(root, encoding="unicode")


def matched(model: pin.Model, made: mujoco.MjModel) -> list[tuple[pin.JointModel, object]]:
    """Pairs of joints, Pinocchio's and MuJoCo's."""
    assert made.nv == model.nv
    return [(model.joints[i], made.joint(model.names[i])) for i in range(1, model.njoints)]


class Terms(NamedTuple):
    """MuJoCo's M and h, and the violation and Jacobian of its equalities, in Pinocchio's v."""

    M: np.ndarray
    h: np.ndarray
    c: np.ndarray
    J: np.ndarray


def terms(made: mujoco.MjModel, model: pin.Model, q: np.ndarray, v: np.ndarray) -> Terms:
    """v_mj = X v, a_mj = X a + Ẋv, as `referee.py` derives them."""
    data = mujoco.MjData(made)
    X, Xdot_v = np.zeros((made.nv, model.nv)), np.zeros(made.nv)
    for joint, there in matched(model, made):
        x = q[joint.idx_q : joint.idx_q + joint.nq]
        rows = there.dofadr[0] + np.arange(joint.nv)
        columns = joint.idx_v + np.arange(joint.nv)
        X[rows, columns] = 1.0
        if joint.nq >= 4:
            x = np.r_[x[:-4], np.roll(x[-4:], 1)]
        if joint.nq == 7:
            R = pin.XYZQUATToSE3(q[joint.idx_q : joint.idx_q + 7]).rotation
            X[np.ix_(rows[:3], columns[:3])] = R
            linear, angular = v[columns[:3]], v[columns[3:]]
            Xdot_v[rows[:3]] = R @ np.cross(angular, linear)
        data.qpos[there.qposadr[0] + np.arange(joint.nq)] = x
    data.qvel[:] = X @ v
    mujoco.mj_fwdPosition(made, data)
    mujoco.mj_fwdVelocity(made, data)
    M = np.zeros((made.nv, made.nv))
    if int(mujoco.__version__.split(".")[0]) >= 4:
        mujoco.mj_fullM(made, data, M)
    else:
        mujoco.mj_fullM(made, M, data.qM)
    J = data.efc_J.reshape(-1, made.nv)[: data.ne]
    h = X.T @ (data.qfrc_bias + M @ Xdot_v)
    return Terms(X.T @ M @ X, h, data.efc_pos[: data.ne].copy(), J @ X)


def row_space(J: np.ndarray) -> np.ndarray:
    _, sigma, Bt = np.linalg.svd(J, full_matrices=False)
    B = Bt[sigma > 1e-6 * sigma[0]]
    return B.T @ B


def test_every_robot_is_read_or_has_a_reason() -> None:
    assert set(FILES) | set(UNREADABLE) | set(REFUSED) == set(cp.available_robots())
    for name, file in FILES.items():
        assert file.suffix in (".urdf", ".xml"), name


@pytest.mark.parametrize("name", REFUSED)
def test_what_mujoco_refuses(name: str) -> None:
    with pytest.raises(ValueError, match=REFUSED[name]):
        read(description(name), robot(name).model)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", FILES)
def test_mass_matrix_and_bias_of_a_file(name: str, seed: int) -> None:
    loaded = robot(name)
    q, v = cp.Scene(loaded, loaded.loops).sample(np.random.default_rng(seed))
    theirs = terms(read(FILES[name], loaded.model), loaded.model, q, v)
    ours = cp.Workspace(cp.Scene(loaded)).terms(q, v)
    scale = np.sqrt(np.diag(theirs.M))
    assert np.abs((ours.M - theirs.M) / np.outer(scale, scale)).max() < AGREES
    assert np.abs(ours.h - theirs.h).max() < AGREES * np.abs(theirs.h).max()


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", MECHANISMS)
def test_loops_of_a_file(name: str, seed: int) -> None:
    loaded = robot(name)
    scene = cp.Scene(loaded, loaded.loops)
    q, v = scene.sample(np.random.default_rng(seed))
    theirs = terms(read(FILES[name], loaded.model), loaded.model, q, v)
    J = cp.Workspace(scene).jacobian(q)
    assert theirs.J.shape == J.shape
    assert np.abs(theirs.c).max() < AGREES
    assert np.abs(theirs.J @ v).max() < AGREES
    assert np.abs(row_space(theirs.J) - row_space(J)).max() < AGREES


@pytest.mark.parametrize("name", MECHANISMS)
def test_postures_and_motors_of_a_file(name: str) -> None:
    loaded = robot(name)
    made = read(FILES[name], loaded.model)
    for k in range(made.nkey):
        q = loaded.postures[made.key(k).name]
        for joint, there in matched(loaded.model, made):
            x = q[joint.idx_q : joint.idx_q + joint.nq]
            x = np.roll(x, 1) if joint.nq == 4 else x
            given = made.key_qpos[k][there.qposadr[0] + np.arange(joint.nq)]
            assert np.allclose(x, given, rtol=0, atol=1e-15)
        assert np.abs(terms(made, loaded.model, q, 0 * q[: loaded.nv]).c).max() < 1e-14
    driven = {made.joint(made.actuator(k).trnid[0]).name for k in range(made.nu)}
    assert driven == set(loaded.actuated)
