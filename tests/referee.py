"""MuJoCo as referee: constrained dynamics by an engine that shares no code with Pinocchio.

A Pinocchio tree and its loops are written as MJCF, MuJoCo computes M, h, J and J̇v, and numpy solves

    M a + h = τ + Jᵀλ,    J a + γ = 0,    γ = J̇v.

Both engines describe the same tree, but not in the same coordinates. For one joint

    joint        Pinocchio                    MuJoCo
    free-flyer   position, xyzw in parent     position, wxyz in world
                 (v, ω) both in body axes     v in world axes, ω in body axes
    spherical    xyzw                         wxyz
    unbounded    (cos α, sin α)               α

so that with the rotation R of the free-flyer's body the velocities and accelerations obey

    v_mj = X v,      X = diag(R, I, I, …),
    a_mj = X a + Ẋv,      Ẋv = R (ω × v) in the free-flyer's linear rows, else 0,

and the principle of virtual work gives Pinocchio's terms

    M = Xᵀ M_mj X,    h = Xᵀ (h_mj + M_mj Ẋv),    J = J_mj X,    γ = J̇_mj v_mj + J_mj Ẋv.

MuJoCo's own accelerations (`qacc`) are no reference: its constraints are soft.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from xml.etree import ElementTree

import mujoco
import numpy as np
import pinocchio as pin

EQUALITY = {"ball": "connect", "weld": "weld"}
# Of the largest singular value: in a planar loop the redundant rows have 1e-13, the others 1e-2.
RANK_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Closure:
    """Two frames held together: in position ("ball", 3 rows) or in pose ("weld", 6 rows).

    Joint 0 is the world.
    """

    kind: str
    joint1: int
    placement1: pin.SE3
    joint2: int
    placement2: pin.SE3


# --- MJCF --------------------------------------------------------------------------------


def to_mjcf(model: pin.Model, closures: Sequence[Closure] = ()) -> str:
    """Write a Pinocchio tree and its closures as MJCF.

    Bodies and joints are called by their Pinocchio index, for names need not be unique. Loops are
    given by sites, because an anchor would take its second point from MuJoCo's zero configuration.
    MuJoCo itself refuses a moving body without mass or inertia, an inertia that no solid has, and
    a free-flyer on another body.
    """
    root = ElementTree.Element("mujoco")
    ElementTree.SubElement(root, "compiler", angle="radian", autolimits="true")
    option = ElementTree.SubElement(
        root, "option", gravity=_text(model.gravity.linear), jacobian="dense"
    )
    ElementTree.SubElement(option, "flag", contact="disable")
    bodies = _add_bodies(ElementTree.SubElement(root, "worldbody"), model)
    equality = ElementTree.SubElement(root, "equality")
    for k, closure in enumerate(closures):
        if closure.kind not in EQUALITY:
            raise ValueError(f"closure kind {closure.kind!r}: MuJoCo knows {sorted(EQUALITY)}")
        _add_site(bodies[closure.joint1], f"{k}a", closure.placement1)
        _add_site(bodies[closure.joint2], f"{k}b", closure.placement2)
        ElementTree.SubElement(equality, EQUALITY[closure.kind], site1=f"{k}a", site2=f"{k}b")
    return ElementTree.tostring(root, encoding="unicode")


def _add_bodies(world: ElementTree.Element, model: pin.Model) -> list[ElementTree.Element]:
    bodies = [world]
    for i, _ in _moving_joints(model):
        body = ElementTree.SubElement(
            bodies[model.parents[i]], "body", name=str(i), **_pose(model.jointPlacements[i])
        )
        _add_inertia(body, model.inertias[i])
        ElementTree.SubElement(body, "joint", name=str(i), **_joint(model, i))
        bodies.append(body)
    return bodies


def _add_inertia(body: ElementTree.Element, inertia: pin.Inertia) -> None:
    """Give principal moments and axes: left to itself, MuJoCo 3 finds them to 1e-7 only."""
    moments, axes = np.linalg.eigh(inertia.inertia)
    right_handed = axes * np.sign(np.linalg.det(axes))
    ElementTree.SubElement(
        body,
        "inertial",
        mass=_text(inertia.mass),
        diaginertia=_text(moments),
        **_pose(pin.SE3(right_handed, inertia.lever)),
    )


def _add_site(body: ElementTree.Element, name: str, placement: pin.SE3) -> None:
    ElementTree.SubElement(body, "site", name=name, **_pose(placement))


def _joint(model: pin.Model, i: int) -> dict[str, str]:
    """Return the MJCF attributes of joint i: its type, axis and armature."""
    joint = model.joints[i]
    armature = model.armature[joint.idx_v : joint.idx_v + joint.nv]
    if joint.nv == 1:
        return {**_axis(model, i), "armature": _text(armature)}
    if armature.any():
        # MuJoCo has one armature a joint, on a free joint along world axes: another mass matrix.
        raise ValueError(f"joint {model.names[i]!r}: armature only on joints of 1 dof: {armature}")
    match joint.shortname():
        case "JointModelFreeFlyer":
            return {"type": "free"}
        case "JointModelSpherical":
            return {"type": "ball"}
    raise ValueError(f"joint {model.names[i]!r}: MuJoCo has no {joint.shortname()}")


def _axis(model: pin.Model, i: int) -> dict[str, str]:
    """Read a 1-dof joint off its motion subspace S = (slide axis, hinge axis)."""
    joint = model.joints[i]
    data = joint.createData()
    joint.calc(data, pin.neutral(model))
    slide, hinge = np.array(data.S).reshape(2, 3)
    if slide.any() and hinge.any():
        raise ValueError(f"joint {model.names[i]!r}: MuJoCo has no {joint.shortname()}")
    kind, axis = ("slide", slide) if slide.any() else ("hinge", hinge)
    return {"type": kind, "axis": _text(axis)}


def _pose(placement: pin.SE3) -> dict[str, str]:
    return {"pos": _text(placement.translation), "quat": _text(_wxyz(placement.rotation))}


def _wxyz(rotation: np.ndarray) -> np.ndarray:
    return np.roll(pin.Quaternion(rotation).coeffs(), 1)


def _text(values: float | Sequence[float] | np.ndarray) -> str:
    return " ".join(f"{x:.17g}" for x in np.atleast_1d(values))


# --- The referee -------------------------------------------------------------------------


class MujocoReferee:
    """MuJoCo's M, h, J and γ in Pinocchio's coordinates (q, v, a, τ)."""

    def __init__(self, model: pin.Model, closures: Sequence[Closure] = ()):
        self.model = model
        self.closures = tuple(closures)
        self._mj = mujoco.MjModel.from_xml_string(to_mjcf(model, closures))
        self._data = mujoco.MjData(self._mj)
        order = [int(self._mj.joint(k).name) for k in range(self._mj.njnt)]
        if order != sorted(order):
            raise ValueError(f"joints must be added depth-first, MuJoCo's order: {order}")

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """M = Xᵀ M_mj X, armature included, (nv, nv)."""
        X, _ = self._place(q)
        return X.T @ self._mass_matrix() @ X

    def bias(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """h = Xᵀ (h_mj + M_mj Ẋv): Coriolis, centrifugal and gravity, (nv,)."""
        X, Xdot_v = self._place(q, v)
        return X.T @ (self._data.qfrc_bias + self._mass_matrix() @ Xdot_v)

    def loop_jacobian(self, q: np.ndarray) -> np.ndarray:
        """J = J_mj X, (m, nv): velocity of the first frame less the second, linear first.

        In world axes, each frame at its own origin: the two coincide in a closed loop.
        """
        X, _ = self._place(q)
        return self._loop_rows(self._site_jacobian) @ X

    def loop_acceleration_drift(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """γ = J̇_mj v_mj + J_mj Ẋv, (m,), in the rows of `loop_jacobian`."""
        X, Xdot_v = self._place(q, v)
        J, Jdot = self._loop_rows(self._site_jacobian), self._loop_rows(self._site_jacobian_rate)
        return Jdot @ X @ v + J @ Xdot_v

    def equality(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return violation (m,) and Jacobian (m, nv) of MuJoCo's own equality constraints.

        Same row space as `loop_jacobian`; of a weld, the angular rows are half of it, in body axes.
        """
        X, _ = self._place(q)
        return self._data.efc_pos.copy(), self._data.efc_J.reshape(-1, self.model.nv) @ X

    def constrained_acceleration(self, q: np.ndarray, v: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Return a of the dense KKT system, with J = U Σ Bᵀ cut to its rank r, (nv,).

        Redundant rows leave λ undetermined, not a: B has as many columns as J has rank,

            [M   B] [ a  ]   [ τ − h   ]
            [Bᵀ  0] [−λ_B] = [−Σ⁻¹ Uᵀ γ],      λ = U Σ⁻¹ λ_B of minimum norm.
        """
        M = self.mass_matrix(q)
        U, sigma, B = truncated_svd(self.loop_jacobian(q))
        gamma = U.T @ self.loop_acceleration_drift(q, v) / sigma
        K = np.block([[M, B], [B.T, np.zeros((sigma.size, sigma.size))]])
        return np.linalg.solve(K, np.r_[tau - self.bias(q, v), -gamma])[: self.model.nv]

    def _place(self, q: np.ndarray, v: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Put MuJoCo in the state (q, v) and return X(q) and Ẋv."""
        v = np.zeros(self.model.nv) if v is None else v
        self._data.qpos[:] = _positions(self.model, q)
        mujoco.mj_fwdPosition(self._mj, self._data)
        X, Xdot_v = self._velocity_map(v)
        self._data.qvel[:] = X @ v
        mujoco.mj_fwdVelocity(self._mj, self._data)
        return X, Xdot_v

    def _velocity_map(self, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        X, Xdot_v = np.eye(self.model.nv), np.zeros(self.model.nv)
        for i, joint in _moving_joints(self.model):
            if joint.nv == 6:
                R = self._data.body(str(i)).xmat.reshape(3, 3)
                linear = slice(joint.idx_v, joint.idx_v + 3)
                angular = slice(joint.idx_v + 3, joint.idx_v + 6)
                X[linear, linear] = R
                Xdot_v[linear] = R @ np.cross(v[angular], v[linear])
        return X, Xdot_v

    def _mass_matrix(self) -> np.ndarray:
        M = np.zeros((self._mj.nv, self._mj.nv))
        if int(mujoco.__version__.split(".")[0]) >= 4:
            mujoco.mj_fullM(self._mj, self._data, M)
        else:
            mujoco.mj_fullM(self._mj, M, self._data.qM)
        return M

    def _loop_rows(self, rows_of_site: Callable[[str], np.ndarray]) -> np.ndarray:
        blocks = [np.zeros((0, self._mj.nv))]
        for k, closure in enumerate(self.closures):
            size = 3 if closure.kind == "ball" else 6
            blocks.append((rows_of_site(f"{k}a") - rows_of_site(f"{k}b"))[:size])
        return np.vstack(blocks)

    def _site_jacobian(self, name: str) -> np.ndarray:
        J = np.zeros((6, self._mj.nv))
        mujoco.mj_jacSite(self._mj, self._data, J[:3], J[3:], self._data.site(name).id)
        return J

    def _site_jacobian_rate(self, name: str) -> np.ndarray:
        Jdot = np.zeros((6, self._mj.nv))
        point, body = self._data.site(name).xpos, self._mj.site(name).bodyid[0]
        mujoco.mj_jacDot(self._mj, self._data, Jdot[:3], Jdot[3:], point, body)
        return Jdot


def truncated_svd(J: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """J = U diag(σ) Bᵀ without its redundant rows: (m, r), (r,), (nv, r)."""
    U, sigma, Bt = np.linalg.svd(J, full_matrices=False)
    rank = np.count_nonzero(sigma > RANK_TOLERANCE * sigma.max(initial=0.0))
    return U[:, :rank], sigma[:rank], Bt[:rank].T


def _moving_joints(model: pin.Model) -> list[tuple[int, pin.JointModel]]:
    return [(i, model.joints[i]) for i in range(1, model.njoints)]


def _positions(model: pin.Model, q: np.ndarray) -> np.ndarray:
    """Return q as MuJoCo counts it, joint by joint."""
    positions = []
    for i, joint in _moving_joints(model):
        x = q[joint.idx_q : joint.idx_q + joint.nq]
        match joint.nq:
            case 7:
                pose = model.jointPlacements[i] * pin.XYZQUATToSE3(x)
                positions += [pose.translation, _wxyz(pose.rotation)]
            case 4:
                positions.append(np.roll(x, 1))
            case 2:
                positions.append([np.arctan2(x[1], x[0])])
            case _:
                positions.append(x)
    return np.concatenate(positions)
