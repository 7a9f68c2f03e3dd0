"""The files of the robots, read by MuJoCo itself: the same M, the same bias.

`test_mujoco.py` gives MuJoCo the tree that Pinocchio made of a file; here it makes its own. Joints
are matched by name, for both engines sort them in their own way.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from shared import robot

import condyn_pin as cp
from condyn_pin.io.description import example_robot_data, robots_folder

AGREES = 1e-10  # measured: 1e-13
SEEDS = (0, 1, 2)

# What MuJoCo says to files that it cannot read.
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


FOLDERS = sorted(path.parent.name for path in robots_folder().glob("*/robot.toml"))
UNREADABLE = {"cassie", *REFUSED}  # cassie is an SDF
FILES = {name: description(name) for name in FOLDERS if name not in UNREADABLE}


def read(file: Path, model: pin.Model) -> mujoco.MjModel:
    """Let MuJoCo read a URDF without shapes, and with its floating base."""
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


def terms(made: mujoco.MjModel, model: pin.Model, q: np.ndarray, v: np.ndarray):
    """M and h of MuJoCo: v_mj = X v, a_mj = X a + Ẋv, as `referee.py` derives them."""
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
    return X.T @ M @ X, X.T @ (data.qfrc_bias + M @ Xdot_v)


@pytest.mark.parametrize("name", REFUSED)
def test_what_mujoco_refuses(name: str) -> None:
    with pytest.raises(ValueError, match=REFUSED[name]):
        read(description(name), robot(name).model)


@pytest.mark.values
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", FILES)
def test_mass_matrix_and_bias_of_a_file(name: str, seed: int) -> None:
    loaded = robot(name)
    q, v = cp.Scene(loaded, loaded.loops).sample(np.random.default_rng(seed))
    M, h = terms(read(FILES[name], loaded.model), loaded.model, q, v)
    ours = cp.Workspace(cp.Scene(loaded)).terms(q, v)
    scale = np.sqrt(np.diag(M))
    assert np.abs((ours.M - M) / np.outer(scale, scale)).max() < AGREES
    assert np.abs(ours.h - h).max() < AGREES * np.abs(h).max()
