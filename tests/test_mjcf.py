"""The MJCF reader against MuJoCo's own reading of the same file."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

import condyn_pin as cp
from condyn_pin._pin import pin

AGREES = 1e-12
INERTIAL = '<inertial pos="0.1 0.02 -0.03" mass="2" diaginertia="0.02 0.03 0.04"/>'


@pytest.fixture
def read(tmp_path: Path):
    """Read a model given as text."""

    def read_text(text: str) -> cp.Robot:
        path = tmp_path / "robot.xml"
        path.write_text(text)
        return cp.load_robot(path)

    return read_text


class Original:
    """MuJoCo's own reading of a file, in Pinocchio's coordinates."""

    def __init__(self, text: str, robot: cp.Robot):
        self.mj = mujoco.MjModel.from_xml_string(text)
        self.data = mujoco.MjData(self.mj)
        self.model = robot.model

    def place(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Put MuJoCo in a state; return X and Xdot v of v_mj = X v."""
        X, Xdot_v = np.eye(self.model.nv), np.zeros(self.model.nv)
        for k in range(self.mj.njnt):
            joint = self.model.joints[k + 1]
            x = q[joint.idx_q : joint.idx_q + joint.nq].copy()
            if joint.nq in (4, 7):
                x[-4:] = np.roll(x[-4:], 1)
            if joint.nq == 7:
                R = np.array(pin.XYZQUATToSE3(q[joint.idx_q : joint.idx_q + 7]).rotation)
                linear = slice(joint.idx_v, joint.idx_v + 3)
                angular = slice(joint.idx_v + 3, joint.idx_v + 6)
                X[linear, linear] = R
                Xdot_v[linear] = R @ np.cross(v[angular], v[linear])
            start = self.mj.jnt_qposadr[k]
            self.data.qpos[start : start + joint.nq] = x
        self.data.qvel[:] = X @ v
        mujoco.mj_forward(self.mj, self.data)
        return X, Xdot_v

    def terms(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return M and h."""
        X, Xdot_v = self.place(q, v)
        M = np.zeros((self.mj.nv, self.mj.nv))
        if int(mujoco.__version__.split(".")[0]) >= 4:
            mujoco.mj_fullM(self.mj, self.data, M)
        else:
            mujoco.mj_fullM(self.mj, M, self.data.qM)
        return X.T @ M @ X, X.T @ (self.data.qfrc_bias + M @ Xdot_v)

    def loop_rows(self, q: np.ndarray) -> np.ndarray:
        """Return the Jacobian of MuJoCo's equalities."""
        X, _ = self.place(q, np.zeros(self.model.nv))
        J = np.zeros((self.data.nefc, self.mj.nv))
        if mujoco.mj_isSparse(self.mj):
            d = self.data
            mujoco.mju_sparse2dense(J, d.efc_J, d.efc_J_rownnz, d.efc_J_rowadr, d.efc_J_colind)
        else:
            J = self.data.efc_J.reshape(-1, self.mj.nv).copy()
        return J[: self.data.ne] @ X


def relative(x: np.ndarray, reference: np.ndarray) -> float:
    return float(np.abs(x - reference).max() / np.abs(reference).max())


def random_state(robot: cp.Robot, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    step, v = rng.normal(size=(2, robot.nv))
    return pin.integrate(robot.model, robot.postures["qpos0"], step), v


def pinocchio_terms(robot: cp.Robot, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    data = robot.model.createData()
    M = np.array(pin.crba(robot.model, data, q))
    M = np.triu(M) + np.triu(M, 1).T
    return M, np.array(pin.nonLinearEffects(robot.model, data, q, v))


EVERYTHING = f"""<mujoco model="everything"><compiler eulerseq="xYz"/>
<option gravity="1 2 -9"/>
<default><joint damping="0.1"/><default class="geared"><joint armature="0.2"/></default></default>
<worldbody>
  <site name="ceiling" pos="0 0 2" zaxis="1 1 0"/>
  <body name="base" pos="0.1 0.2 0.3" axisangle="1 2 3 40"><freejoint name="float"/>{INERTIAL}
    <body name="arm" pos="0.3 0 0" euler="10 20 -30" childclass="geared">{INERTIAL}
      <joint name="turn" axis="1 1 0" pos="0.1 -0.2 0.3" ref="20" range="-90 90"/>
      <joint name="push" type="slide" axis="0 1 2" pos="0.3 0 0" ref="0.2"/>
      <joint name="twist" axis="0 0 -3" pos="0 0.1 0" stiffness="5" springref="10"/>
      <site name="hand" pos="0 0 0.5" xyaxes="0 1 0 1 1 0"/>
      <body name="plate" pos="0 0.2 0" quat="1 0.2 0.3 0.4">
        <inertial pos="0 0 0.1" mass="0.5" fullinertia="0.01 0.02 0.025 0.001 0.002 0.003"/>
        <body name="wrist"><joint name="ball" type="ball" pos="0.05 0 0.1"/>{INERTIAL}</body>
      </body>
    </body>
  </body>
  <body name="post" pos="1 0 0"><body name="door" pos="0 1 0" euler="0 0 90">
    <joint name="hinge"/>{INERTIAL}</body></body>
</worldbody></mujoco>"""


@pytest.mark.parametrize("seed", range(3))
def test_every_joint_moves_as_in_mujoco(read, seed):
    robot = read(EVERYTHING)
    original = Original(EVERYTHING, robot)
    q, v = random_state(robot, seed)
    M, h = pinocchio_terms(robot, q, v)
    M_mj, h_mj = original.terms(q, v)
    # MuJoCo keeps principal axes of a full inertia, found to 1e-7
    assert relative(M, M_mj) < 1e-7
    assert relative(h, h_mj) < 1e-7
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    for kind, objects in (("body", original.mj.nbody), ("site", original.mj.nsite)):
        for k in range(objects):
            at = getattr(original.data, kind)(k)
            joint, placement = robot.frame(at.name)
            oMf = data.oMi[joint] * placement
            where = (at.xpos, at.xmat)
            assert np.abs(oMf.translation - where[0]).max() < AGREES
            assert np.abs(np.array(oMf.rotation).ravel() - where[1]).max() < AGREES


# Loops --------------------------------------------------------------------------------------------

TWO_ARMS = f"""<mujoco><compiler angle="radian"/><worldbody><site name="wall" pos="0.3 0.4 0.5"/>
<body name="a" pos="1 0 0" euler="0.3 0 0">{INERTIAL}<joint name="ja" ref="0.5" pos="0.1 0.2 0.3"/>
  <site name="sa" pos="0.1 0.2 0.3" euler="0.3 0.2 0.1"/>
  <body name="c" pos="0 0 1"><joint name="jc" type="ball"/>{INERTIAL}</body></body>
<body name="b" pos="0 2 0" euler="0 0.2 0">{INERTIAL}<joint name="jb" type="slide" ref="-0.1"/>
  <site name="sb" pos="0.1 0 0.3"/></body>
</worldbody><equality>EQUALITY</equality></mujoco>"""


@pytest.mark.parametrize(
    ("equality", "kind", "rows"),
    [
        ('<connect body1="c" body2="b" anchor="0.1 0.2 0.3"/>', "ball", 3),
        ('<connect body1="c" anchor="0.1 0.2 0.3"/>', "ball", 3),
        ('<connect site1="sa" site2="sb"/>', "ball", 3),
        ('<connect site1="wall" site2="sb"/>', "ball", 3),
        ('<weld body1="c" body2="b" anchor="0.01 0.02 0.03"/>', "weld", 6),
        ('<weld body1="c"/>', "weld", 6),
        ('<weld body1="c" body2="b" relpose="0.1 0.2 0.3 0.9 0.1 0 0"/>', "weld", 6),
        ('<weld body1="c" body2="b" relpose="1 2 3 2 0.1 0 1" anchor=".1 .2 .3"/>', "weld", 6),
        ('<weld site1="sa" site2="sb"/>', "weld", 6),
        ('<weld site1="sa" site2="sb" torquescale="0"/>', "ball", 3),
    ],
)
def test_loops_hold_what_mujoco_holds(read, equality, kind, rows):
    text = TWO_ARMS.replace("EQUALITY", equality)
    robot = read(text)
    (loop,) = robot.loops
    assert (loop.kind, loop.rows) == (kind, rows)
    original = Original(text, robot)
    drawn = robot.postures["qpos0"]
    for q in (drawn, *(random_state(robot, seed)[0] for seed in range(3))):
        original.place(q, np.zeros(robot.nv))
        data = robot.model.createData()
        pin.forwardKinematics(robot.model, data, q)
        ends = (robot.frame(name) for name in (loop.frame_a, loop.frame_b))
        oMa, oMb = (data.oMi[joint] * placement for joint, placement in ends)
        gap = original.data.efc_pos
        assert np.abs(oMa.translation - oMb.translation - gap[:3]).max() < AGREES
        if kind == "weld":
            angle = np.linalg.norm(pin.log3((oMa.inverse() * oMb).rotation))
            assert np.linalg.norm(gap[3:]) == pytest.approx(np.sin(angle / 2), abs=AGREES)
    original.place(drawn, np.zeros(robot.nv))
    is_open = np.abs(original.data.efc_pos).max() > 1e-6
    assert any("open by" in text for text in robot.unused) == is_open


def test_a_joint_equality_is_a_coupling(read):
    equality = '<joint name="gear" joint1="ja" joint2="jb" polycoef="0.1 2"/>'
    text = TWO_ARMS.replace("EQUALITY", equality)
    robot = read(text)
    (coupling,) = robot.loops
    assert isinstance(coupling, cp.Coupling)
    assert (coupling.joint_a, coupling.joint_b, coupling.ratio) == ("ja", "jb", 2.0)
    original = Original(text, robot)
    q = robot.postures["qpos0"].copy()
    q[-1] += 0.3
    a, b = (robot.model.joints[robot.model.getJointId(n)].idx_q for n in ("ja", "jb"))
    q[a] = coupling.ratio * q[b] + coupling.offset
    original.place(q, np.zeros(robot.nv))
    assert np.abs(original.data.efc_pos).max() < AGREES
