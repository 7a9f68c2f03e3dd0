"""MuJoCo as referee: constrained dynamics by an engine that shares no code with Pinocchio.

A robot and its loops are written as MJCF by `Robot.to_mjcf`, MuJoCo computes M, h, J and J̇v, and
numpy solves

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

from collections.abc import Callable

import mujoco
import numpy as np
import pinocchio as pin

import condyn_pin as cp

# Of the largest singular value: in a planar loop the redundant rows have 1e-13, the others 1e-2.
RANK_TOLERANCE = 1e-6


class MujocoReferee:
    """MuJoCo's M, h, J and γ in Pinocchio's coordinates (q, v, a, τ)."""

    def __init__(self, robot: cp.Robot, text: str | None = None):
        """Take a robot and an MJCF of it, by default the one that the library writes."""
        self.model = robot.model
        self.loops = robot.loops
        self._mj = mujoco.MjModel.from_xml_string(robot.to_mjcf() if text is None else text)
        self._mj.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        self.data = mujoco.MjData(self._mj)
        names = [self._mj.joint(k).name for k in range(self._mj.njnt)]
        if names != [name if self._mj.joint(k).name else "" for k, name in enumerate(robot.joints)]:
            raise ValueError(f"MuJoCo has other joints, or another order: {names}")

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """M = Xᵀ M_mj X, armature included, (nv, nv)."""
        X, _ = self._place(q)
        return X.T @ self._mass_matrix() @ X

    def bias(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """h = Xᵀ (h_mj + M_mj Ẋv): Coriolis, centrifugal and gravity, (nv,)."""
        X, Xdot_v = self._place(q, v)
        return X.T @ (self.data.qfrc_bias + self._mass_matrix() @ Xdot_v)

    def passive(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """τ = Xᵀ qfrc_passive: springs, dampers, and all else that MuJoCo counts there, (nv,)."""
        X, _ = self._place(q, v)
        return X.T @ self.data.qfrc_passive

    def loop_jacobian(self, q: np.ndarray) -> np.ndarray:
        """J = J_mj X, (m, nv): velocity of the first frame less the second, linear first.

        In world axes, each frame at its own origin: the two coincide in a closed loop.
        """
        X, _ = self._place(q)
        return self._loop_rows(self._site_jacobian, self._coupling_row) @ X

    def loop_acceleration_drift(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """γ = J̇_mj v_mj + J_mj Ẋv, (m,), in the rows of `loop_jacobian`."""
        X, Xdot_v = self._place(q, v)
        J = self._loop_rows(self._site_jacobian, self._coupling_row)
        Jdot = self._loop_rows(self._site_jacobian_rate, lambda _: np.zeros((1, self._mj.nv)))
        return Jdot @ X @ v + J @ Xdot_v

    def equality(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return violation (m,) and Jacobian (m, nv) of MuJoCo's own equality constraints.

        Same row space as `loop_jacobian`; of a weld, the angular rows are half of it, in body axes.
        """
        X, _ = self._place(q)
        rows = slice(self.data.ne)  # limits come after
        return self.data.efc_pos[rows].copy(), self.data.efc_J.reshape(-1, self.model.nv)[rows] @ X

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
        self.data.qpos[:] = _positions(self.model, q)
        mujoco.mj_fwdPosition(self._mj, self.data)
        X, Xdot_v = self._velocity_map(v)
        self.data.qvel[:] = X @ v
        mujoco.mj_fwdVelocity(self._mj, self.data)
        return X, Xdot_v

    def _velocity_map(self, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        X, Xdot_v = np.eye(self.model.nv), np.zeros(self.model.nv)
        for k, (_, joint) in enumerate(_moving_joints(self.model)):
            if joint.nv == 6:
                R = self.data.xmat[self._mj.jnt_bodyid[k]].reshape(3, 3)
                linear = slice(joint.idx_v, joint.idx_v + 3)
                angular = slice(joint.idx_v + 3, joint.idx_v + 6)
                X[linear, linear] = R
                Xdot_v[linear] = R @ np.cross(v[angular], v[linear])
        return X, Xdot_v

    def _mass_matrix(self) -> np.ndarray:
        M = np.zeros((self._mj.nv, self._mj.nv))
        if int(mujoco.__version__.split(".")[0]) >= 4:
            mujoco.mj_fullM(self._mj, self.data, M)
        else:
            mujoco.mj_fullM(self._mj, M, self.data.qM)
        return M

    def _loop_rows(
        self,
        rows_of_site: Callable[[int], np.ndarray],
        coupling_row: Callable[[cp.constraints.Coupling], np.ndarray],
    ) -> np.ndarray:
        blocks = [np.zeros((0, self._mj.nv))]
        for loop in self.loops:
            if isinstance(loop, cp.constraints.Coupling):
                blocks.append(coupling_row(loop))
                continue
            k = self._mj.equality(loop.name).id
            one, two = self._mj.eq_obj1id[k], self._mj.eq_obj2id[k]
            blocks.append((rows_of_site(one) - rows_of_site(two))[: loop.rows])
        return np.vstack(blocks)

    def _coupling_row(self, coupling: cp.constraints.Coupling) -> np.ndarray:
        row = np.zeros((1, self._mj.nv))
        row[0, self._mj.joint(coupling.joint_a).dofadr[0]] = 1.0
        row[0, self._mj.joint(coupling.joint_b).dofadr[0]] = -coupling.ratio
        return row

    def _site_jacobian(self, site: int) -> np.ndarray:
        J = np.zeros((6, self._mj.nv))
        mujoco.mj_jacSite(self._mj, self.data, J[:3], J[3:], site)
        return J

    def _site_jacobian_rate(self, site: int) -> np.ndarray:
        Jdot = np.zeros((6, self._mj.nv))
        point, body = self.data.site_xpos[site], self._mj.site_bodyid[site]
        mujoco.mj_jacDot(self._mj, self.data, Jdot[:3], Jdot[3:], point, body)
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


def _wxyz(rotation: np.ndarray) -> np.ndarray:
    return np.roll(pin.Quaternion(rotation).coeffs(), 1)
