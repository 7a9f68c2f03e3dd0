"""Contact problems with known answers, and others that are well posed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

import condyn_pin as cp
from condyn_pin.contact import ContactProblem

GRAVITY = 9.81  # [m/s^2]


class Touching(NamedTuple):
    """A contact problem, and the body that it is about."""

    problem: ContactProblem
    J: np.ndarray
    M: np.ndarray
    v_free: np.ndarray

    def after(self, lam: np.ndarray) -> np.ndarray:
        """Return the velocity after the step."""
        return self.v_free + np.linalg.solve(self.M, self.J.T @ lam)


def touching(J, M, v_free, friction, **fields) -> Touching:
    X = np.linalg.solve(np.linalg.cholesky(M), J.T)
    return Touching(ContactProblem(X.T @ X, J @ v_free, friction, **fields), J, M, v_free)


def box(v=(0.0, 0.0, 0.0), push=(0.0, 0.0, 0.0), mu=0.5, dt=1e-2, slope=0.0, **fields) -> Touching:
    """Return a box of 1 kg, 0.2 x 0.2 x 0.1 m, on its four corners; slope [rad] down along x."""
    size = np.array([0.2, 0.2, 0.1])
    inertia = (size @ size - size**2) / 12
    corners = [(x, y, -0.05) for x in (0.1, -0.1) for y in (0.1, -0.1)]
    J = np.vstack([np.hstack([np.eye(3), -pin.skew(np.array(p))]) for p in corners])
    fall = GRAVITY * np.array([np.sin(slope), 0.0, -np.cos(slope)])
    v_free = np.concatenate([np.array(v) + dt * (fall + push), np.zeros(3)])
    M = np.diag([1.0, 1.0, 1.0, *inertia])
    return touching(J, M, v_free, np.full(4, mu), **fields)


def solo12(v_x=0.0, mu=0.7, dt=1e-3, **fields) -> Touching:
    """Return Solo12 on its four feet, its motors carrying it, at v_x [m/s]."""
    robot = cp.load_robot("solo12")
    q, *_ = cp.Scene(robot, robot.contacts).state()
    model, data = robot.model, robot.model.createData()
    v = np.zeros(model.nv)
    v[0] = v_x
    pin.computeAllTerms(model, data, q, v)
    M = np.triu(data.M) + np.triu(data.M, 1).T
    frames = [model.getFrameId(contact.frame) for contact in robot.contacts]
    along = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    J = np.vstack([pin.computeFrameJacobian(model, data, q, frame, along)[:3] for frame in frames])
    weight = GRAVITY * sum(body.mass for body in model.inertias)
    tau = data.nle - J.T @ np.tile([0.0, 0.0, weight / 4], 4)
    tau[:6] = 0.0
    v_free = v + dt * np.linalg.solve(M, tau - data.nle)
    return touching(J, M, v_free, np.full(4, mu), **fields)


def rod(mu: float, dt: float, angle: float = 63.4349) -> ContactProblem:
    """Return Painleve's rod of 1 kg and 2 m that slides at 1 m/s, `angle` [deg] to the ground."""
    cos, sin = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    J = np.array([[1.0, 0.0, sin], [0.0, 0.0, 0.0], [0.0, 1.0, -cos]])
    M = np.diag([1.0, 1.0, 1 / 3])
    return touching(J, M, np.array([-1.0, -dt * GRAVITY, 0.0]), [mu]).problem


def rolling_sole() -> ContactProblem:
    """Return a sole of Talos that rolls over an edge: two corners slide, one sticks, one opens.

    Its corners are redundant, G = X^T X, and curved paths make their g contradict a little.
    """
    X = np.zeros((6, 12))
    X[0] = [0.6998, 0.052486, 0.215918, 0.582839, 0.146378, 0.334854,
            0.553663, -0.129559, -0.12236, 0.436701, -0.035667, -0.003423]  # fmt: skip
    X[1, 1:] = [0.583421, -0.357637, -0.038129, 0.614029, -0.183894,
                -0.047641, 0.524075, -0.088679, -0.08577, 0.554683, 0.085063]  # fmt: skip
    X[2, 2:] = [-0.400376, 0.021205, -0.017022, -0.294622,
                0.026494, 0.033004, -0.22112, 0.047699, 0.015982, -0.115366]  # fmt: skip
    X[3, 3:] = [-0.152097, 0.122096, -0.126571, -0.190037,
                -0.236731, 0.006916, -0.342134, -0.114634, -0.119655]  # fmt: skip
    X[4, 5], X[4, 8], X[4, 11] = -0.267112, 0.091177, -0.175936
    X[5, 8], X[5, 11] = 0.326741, 0.326741
    g = [0.01747, -0.025865, -0.018583, -0.002374, -0.009935, -0.021065,
         -0.007324, -0.056752, -0.034154, -0.027168, -0.040822, -0.036609]  # fmt: skip
    return ContactProblem(X.T @ X, g, np.full(4, 0.7))


def random(
    seed: int,
    cones: int = 4,
    mu: float = 0.7,
    half_lines: int = 0,
    intervals: int = 0,
    joints: int = 18,
    **fields,
) -> ContactProblem:
    """Return a problem of a robot with random Jacobians: g is a velocity that it can have."""
    rng = np.random.default_rng(seed)
    m = 3 * cones + half_lines + intervals
    X = rng.normal(size=(joints, m)) / np.sqrt(joints)
    g = X.T @ rng.normal(size=joints)
    limits = rng.uniform(0.0, 0.5, intervals)
    return ContactProblem(X.T @ X, g, np.full(cones, mu), half_lines, limits, **fields)


def bodies(seed: int, **fields) -> ContactProblem:
    """Return bodies of 1 g to 1 t that touch each other and the ground, friction 1e-3 to 100.

    g is a velocity that they can have, and contacts are often redundant.
    """
    rng = np.random.default_rng(seed)
    count, k = rng.integers(1, 4), rng.integers(2, 9)
    masses = 10.0 ** rng.uniform(-3, 3, count)
    J_T = np.zeros((6 * count, 3 * k))
    for i in range(k):
        E = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        one, other = rng.permutation(count + 1)[:2]  # the last one is the ground
        for body, sign in ((one, 1), (other, -1)):
            if body < count:
                p = rng.normal(scale=0.2, size=3)
                rows = np.vstack([E.T, np.cross(p, E).T])
                J_T[6 * body : 6 * body + 6, 3 * i : 3 * i + 3] = sign * rows
    g = J_T.T @ rng.normal(size=6 * count)
    X = (
        J_T
        * np.repeat(1 / np.sqrt(masses), 6)[:, None]
        * np.tile([1, 1, 1, 10, 10, 10], count)[:, None]
    )
    return ContactProblem(X.T @ X, g, 10.0 ** rng.uniform(-3, 2, k), **fields)


def on_a_rough_floor(
    name: str, friction: float
) -> tuple[cp.Scene, np.ndarray, np.ndarray, np.ndarray]:
    """Return a robot that comes down, with q, v and tau, and a joint off by 1e-6 rad.

    Talos does on two edges: G of what closes is singular but for that.
    """
    robot, rng = cp.load_robot(name), np.random.default_rng(0)
    scene = cp.Scene(robot, contacts=robot.frictional_contacts(friction=friction))
    v, tau = 0.005 * rng.normal(size=robot.nv), 0.1 * rng.normal(size=robot.nv)
    v[2] -= 0.05
    q = cp.mechanism.place_on_ground(scene, scene.state()[0])
    q[2] -= 1e-4
    return scene, pin.integrate(robot.model, q, 1e-6 * np.eye(robot.nv)[15]), v, tau


def natural(problem: ContactProblem, lam: np.ndarray) -> float:
    """Return the natural residual, contact by contact as one would write it on a whiteboard."""
    R = np.zeros(problem.rows) if problem.R is None else problem.R
    sigma = problem.G @ lam + R * lam + problem.g
    rho = problem.rows / (np.trace(problem.G) + R.sum())
    k, lines = len(problem.friction), problem.half_lines
    worst = 0.0
    for i, mu in enumerate(problem.friction):
        rows = slice(3 * i, 3 * i + 3)
        d = sigma[rows].copy()
        if problem.law == "ncp":
            d[2] += mu * np.linalg.norm(d[:2])
        worst = max(worst, missed_by_a_cone(lam[rows], rho * sigma[rows], rho * d, mu))
    for j in range(3 * k, 3 * k + lines):
        worst = max(worst, abs(lam[j] - max(lam[j] - rho * sigma[j], 0.0)))
    for j, limit in enumerate(problem.limits, 3 * k + lines):
        worst = max(worst, abs(lam[j] - np.clip(lam[j] - rho * sigma[j], -limit, limit)))
    return worst / rho / np.abs(problem.g).max()


def missed_by_a_cone(lam: np.ndarray, sigma: np.ndarray, d: np.ndarray, mu: float) -> float:
    """Return what a contact misses; what K contains solves the problem whose g is less by sigma."""
    missed = np.abs(lam - onto_cone(lam - d, mu)).max()
    if not in_cone(lam, mu):
        return missed
    stuck = np.abs(sigma).max()
    return stuck if in_cone(lam - d, mu) else min(missed, stuck)


def in_cone(x: np.ndarray, mu: float) -> bool:
    """Return whether |x_t| <= mu x_n."""
    return x[2] >= 0 and np.hypot(*x[:2]) <= mu * x[2]


def onto_cone(x: np.ndarray, mu: float) -> np.ndarray:
    """Return the point of |x_t| <= mu x_n that is nearest to x."""
    slip, n = np.linalg.norm(x[:2]), x[2]
    if mu * slip <= -n:
        return np.zeros(3)
    if slip <= mu * n:
        return x
    normal = (mu * slip + n) / (1 + mu**2)
    return np.array([*(mu * normal * x[:2] / slip), normal])
