"""Ticks of a controller, each beside the same program written down with Pinocchio and quadprog.

    min  sum w |J a - b|^2 + eps (|a|^2 + |lam / m|^2)
    with M a + h = S^T tau + J_c^T lam,    J_c a + gamma = 0,    |tau| <= tau_max,    lam in cones

Nothing of the library's terms, reduction, solvers or polish has a part in it: forces are in the
axes of the world, equations are eliminated by singular values. States, tasks and friction are
random.
"""

from __future__ import annotations

import functools

import numpy as np
import pinocchio as pin
import pytest
from shared import robot

import condyn_pin as cp
from condyn_pin.contact import FrictionCone
from condyn_pin.control import CenterOfMass, Controller, JointTask, Orientation, Posture
from condyn_pin.mechanism import project_velocity

quadprog = pytest.importorskip("quadprog")
pytest.importorskip("proxsuite")
pytest.importorskip("daqp")

EPS = 1e-5
ALIGNED = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
CORNERS = [(x, y, 0.0) for x in (-0.1, 0.1) for y in (-0.06, 0.06)]
BASE = {"solo12": "base_link", "talos": "base_link"}


@functools.cache
def scene_of(name: str) -> cp.Scene:
    made = robot(name)
    if name == "solo12":
        return cp.Scene(made, made.contacts)
    soles = ("left_sole_link", "right_sole_link")
    corners = [
        cp.PointContact(sole, offset=p, name=f"{sole} {i}")
        for sole in soles for i, p in enumerate(CORNERS)
    ]  # fmt: skip
    return cp.Scene(made, corners)


def points(scene: cp.Scene, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """J and Jdot v of the contact points, in the axes of the world."""
    model, rows, drifts = scene.robot.unedited, [], []
    data = model.createData()
    pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
    pin.computeJointJacobians(model, data, q)
    for contact in scene.constraints:
        joint, place = scene.robot.frame(contact.frames[0])
        offset = np.array(getattr(contact, "offset", (0.0, 0.0, 0.0)), dtype=float)
        at = place * pin.SE3(np.eye(3), offset)
        rows.append(pin.getFrameJacobian(model, data, joint, at, ALIGNED)[:3].copy())
        drifts.append(
            pin.getFrameClassicalAcceleration(model, data, joint, at, ALIGNED).linear.copy()
        )
    return np.vstack(rows), np.concatenate(drifts)


def mass_and_bias(model, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    upper = np.triu(pin.crba(model, model.createData(), q))
    h = pin.rnea(model, model.createData(), q, v, np.zeros(model.nv)).copy()
    return upper + np.triu(upper, 1).T, h


def by_hand(
    scene: cp.Scene, q: np.ndarray, v: np.ndarray, friction: float, wishes: list[tuple]
) -> np.ndarray | None:
    """The accelerations (nv,) of the program; None where nothing answers it."""
    made, model = scene.robot, scene.robot.unedited
    nv, m = model.nv, made.mass
    M, h = mass_and_bias(model, q, v)
    J, drift = points(scene, q, v)
    k, motors = len(J), nv - 6
    A = np.block([[M[:6] / m, -J[:, :6].T], [J, np.zeros((k, k))]])
    b = np.concatenate((-h[:6] / m, -drift))
    H, g = EPS * np.eye(nv + k), np.zeros(nv + k)
    for weight, rows, wanted in wishes:
        H[:nv, :nv] += weight * rows.T @ rows
        g[:nv] -= weight * rows.T @ wanted
    torque = np.hstack((M[6:] / m, -J[:, 6:].T))
    most = np.where(model.effortLimit[6:] > 0, model.effortLimit[6:], np.inf) / m
    side = np.array([[0.0, 0, -1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    side[1:, 2] = -friction / np.sqrt(2.0)
    floor = np.hstack((np.zeros((5 * (k // 3), nv)), np.kron(np.eye(k // 3), side)))
    if not friction:  # an equation each
        slip = np.kron(np.eye(k // 3), np.eye(3)[:2])
        A = np.vstack((A, np.hstack((np.zeros((len(slip), nv)), slip))))
        b = np.append(b, np.zeros(len(slip)))
        floor = floor[::5]
    C = np.vstack((torque, -torque, floor))
    d = np.concatenate((most - h[6:] / m, most + h[6:] / m, np.zeros(len(floor))))
    assert motors == len(most)
    U, S, Vt = np.linalg.svd(A / np.linalg.norm(A, axis=1)[:, None])
    b = b / np.linalg.norm(A, axis=1)
    rank = int(np.count_nonzero(1e-9 * S[0] < S))
    x = Vt[:rank].T @ ((U[:, :rank].T @ b) / S[:rank])
    if np.abs(U[:, rank:].T @ b).max(initial=0.0) > 1e-7:
        return None
    Z = Vt[rank:].T
    counts = np.isfinite(d)
    try:
        s = quadprog.solve_qp(
            Z.T @ H @ Z, -Z.T @ (g + H @ x), -(C[counts] @ Z).T, (C @ x - d)[counts]
        )[0]
    except ValueError as error:
        if "inconsistent" not in str(error):
            raise
        return None
    return (x + Z @ s)[:nv]


def question(name: str, seed: int) -> tuple[np.ndarray, np.ndarray, float, list, list[tuple]]:
    """A random state, friction, tasks, and the rows of these tasks."""
    scene, rng = scene_of(name), np.random.default_rng(seed)
    made, model = scene.robot, scene.robot.unedited
    q, _ = scene.state()
    q = pin.integrate(model, q, rng.choice([0.0, 0.02, 0.1]) * rng.normal(size=model.nv))
    v = project_velocity(scene, q, rng.choice([0.0, 0.05, 0.3]) * rng.normal(size=model.nv))
    v[np.abs(v) < 1e-13] = 0.0
    friction = float(rng.choice([0.0, 0.3, 0.6, 1.0]))
    pull = rng.choice([0.5, 5.0, 12.0]) * rng.normal(size=3)
    turn, wish = rng.normal(size=3), float(20.0 * rng.normal())
    joint = str(rng.choice(made.actuated))
    home = q.copy()
    home[7:] += 0.1 * rng.normal(size=model.nq - 7)
    tasks = [
        CenterOfMass(a=tuple(pull), weight=100.0),
        Orientation(BASE[name], a=tuple(turn), weight=10.0),
        JointTask(joint, a=wish, weight=1.0), Posture(home, kp=50.0, weight=0.1),
    ]  # fmt: skip
    data = model.createData()
    com = pin.jacobianCenterOfMass(model, data, q).copy()
    pin.centerOfMass(model, data, q, v, np.zeros(model.nv))
    of_com = pull - data.acom[0]
    pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
    pin.computeJointJacobians(model, data, q)
    at, place = made.frame(BASE[name])
    of_base = pin.getFrameJacobian(model, data, at, place, ALIGNED)[3:].copy()
    drift = pin.getFrameClassicalAcceleration(model, data, at, place, ALIGNED).angular
    column = model.joints[model.getJointId(joint)].idx_v
    every = np.eye(model.nv)[6:]
    back = 50.0 * (home[7:] - q[7:]) - 2.0 * np.sqrt(50.0) * v[6:]
    wishes = [
        (100.0, com, of_com), (10.0, of_base, turn - drift),
        (1.0, np.eye(model.nv)[[column]], np.array([wish])), (0.1, every, back),
    ]  # fmt: skip
    return q, v, friction, tasks, wishes


def verdict(name: str, seed: int) -> str:
    """How the tick of the library compares: right, wrong, or told."""
    scene = scene_of(name)
    q, v, friction, tasks, wishes = question(name, seed)
    out = Controller(scene, tasks, cones=FrictionCone(friction), regularisation=EPS).solve(q, v)
    right = by_hand(scene, q, v, friction, wishes)
    if right is None:
        return "right" if out.status is cp.control.ControlStatus.INFEASIBLE else "wrong"
    if not out.status.ok:
        return f"told: {out.status.name}"
    size = max(9.81, float(np.abs(right).max()))
    return "right" if np.abs(out.a - right).max() < 1e-5 * size else "wrong"


@pytest.mark.parametrize("seed", range(40))
def test_ticks_of_four_feet_are_those_of_the_program_by_hand(seed):
    assert verdict("solo12", seed) == "right"


@pytest.mark.parametrize("seed", range(10))
def test_ticks_on_the_corners_of_two_soles_are_those_of_the_program_by_hand(seed):
    assert verdict("talos", seed) == "right"
