"""A scene as a MultibodyPlant of Drake, with its coordinates.

Drake's coordinates of a free body are quaternion w x y z and position, then angular and linear
velocity in the axes of the world; of a ball, roll, pitch, yaw and the angular velocity in the axes
of its parent. With R the rotation of body or ball,

    free:  omega_d = R omega, v_d = R v,   a = R' a_d - omega x v,   domega = R' domega_d
    ball:  omega_d = R omega,              domega = R' domega_d
"""

from __future__ import annotations

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.multibody import plant as drake
from pydrake.multibody import tree

from peers.exported import Exported, Joint


class Engine:
    """A plant of a scene, and the exported states in its coordinates."""

    def __init__(self, scene: Exported, step: float) -> None:
        self.scene, self.step = scene, step
        self.plant = plant = drake.MultibodyPlant(time_step=step)
        plant.set_discrete_contact_approximation(drake.DiscreteContactApproximation.kSap)
        plant.mutable_gravity_field().set_gravity_vector(scene.gravity)
        self.bodies = [_ground(plant)]
        self.joints: list[tree.Joint | None] = [None]
        for joint in scene.joints:
            self._add(joint)
        for c in scene.constraints:
            A, B = self.bodies[c.joint1], self.bodies[c.joint2]
            if c.rows == 3:
                plant.AddBallConstraint(A, c.placement1[1], B, c.placement2[1])
            else:
                plant.AddWeldConstraint(A, _pose(c.placement1), B, _pose(c.placement2))
        plant.SetUseSampledOutputPorts(False)  # else a step is no discrete update
        plant.Finalize()
        self.context = plant.CreateDefaultContext()
        self.torque = plant.get_applied_generalized_force_input_port()
        q, v, tau = (scene.states[key] for key in ("q", "v", "tau"))
        self.x = [self.state(*qv) for qv in zip(q, v, strict=True)]
        self.tau = [self.velocity(*pair) for pair in zip(q, tau, strict=True)]

    def _add(self, joint: Joint) -> None:
        plant, parent = self.plant, self.bodies[joint.parent]
        entries = joint.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]  # moments, then products
        about_centre = tree.RotationalInertia(*entries)
        inertia = tree.SpatialInertia.MakeFromCentralInertia(joint.mass, joint.lever, about_centre)
        body = plant.AddRigidBody(f"{joint.name}_body", inertia)
        frame = plant.AddFrame(
            tree.FixedOffsetFrame(f"{joint.name}_on", parent.body_frame(), _pose(joint.placement))
        )
        ends, made = (joint.name, frame, body.body_frame()), None
        if joint.kind == "ball":
            made = plant.AddJoint(tree.BallRpyJoint(*ends))
        elif joint.kind in ("revolute", "prismatic"):
            kind = {"revolute": tree.RevoluteJoint, "prismatic": tree.PrismaticJoint}[joint.kind]
            made = plant.AddJoint(kind(*ends, joint.axis, damping=0.0))
            if joint.armature:
                actuator = plant.AddJointActuator(f"{joint.name}_motor", made)
                actuator.set_default_gear_ratio(1.0)
                actuator.set_default_rotor_inertia(joint.armature)
        self.bodies.append(body)
        self.joints.append(made)

    def columns(self, k: int) -> tuple[slice, slice]:
        """Return where Drake has the position and the velocity of joint k of the list."""
        joint, body = self.joints[k + 1], self.bodies[k + 1]
        if joint is None:
            q, v = body.floating_positions_start(), body.floating_velocities_start_in_v()
            return slice(q, q + 7), slice(v, v + 6)
        q, v = joint.position_start(), joint.velocity_start()
        return slice(q, q + joint.num_positions()), slice(v, v + joint.num_velocities())

    def state(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return Drake's (q, v)."""
        x = np.zeros(self.plant.num_positions() + self.plant.num_velocities())
        for k, joint in enumerate(self.scene.joints):
            part, (where, _) = q[joint.idx_q : joint.idx_q + joint.nq], self.columns(k)
            if joint.kind == "free":
                x[where] = np.concatenate([np.roll(part[3:], 1), part[:3]])
            elif joint.kind == "ball":
                x[where] = RollPitchYaw(rotation(part)).vector()
            else:
                x[where] = part
        x[self.plant.num_positions() :] = self.velocity(q, v)
        return x

    def velocity(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return Drake's velocity (or generalized force) from Pinocchio's."""
        found = np.zeros(self.plant.num_velocities())
        for k, joint in enumerate(self.scene.joints):
            part, (_, where) = v[joint.idx_v : joint.idx_v + joint.nv], self.columns(k)
            if joint.kind in ("free", "ball"):
                R = rotation(q[joint.idx_q + joint.nq - 4 : joint.idx_q + joint.nq])
                turned = (R @ part.reshape(-1, 3).T).T
                part = turned[::-1].ravel()  # of a free body, the angular part comes first
            found[where] = part
        return found

    def acceleration(self, q: np.ndarray, v: np.ndarray, a_drake: np.ndarray) -> np.ndarray:
        """Return a from Drake's."""
        a = np.zeros(self.scene.nv)
        for k, joint in enumerate(self.scene.joints):
            here, part = slice(joint.idx_v, joint.idx_v + joint.nv), a_drake[self.columns(k)[1]]
            if joint.kind in ("free", "ball"):
                R = rotation(q[joint.idx_q + joint.nq - 4 : joint.idx_q + joint.nq])
                part = (R.T @ part.reshape(-1, 3)[::-1].T).T.ravel()
                if joint.kind == "free":
                    part[:3] -= np.cross(v[here][3:], v[here][:3])
            a[here] = part
        return a

    def configuration(self, x: np.ndarray) -> np.ndarray:
        """Return Pinocchio's q."""
        q = np.zeros(self.scene.states["q"].shape[1])
        for k, joint in enumerate(self.scene.joints):
            part, here = x[self.columns(k)[0]], slice(joint.idx_q, joint.idx_q + joint.nq)
            if joint.kind == "free":
                q[here] = np.concatenate([part[4:], np.roll(part[:4], -1)])
            elif joint.kind == "ball":
                q[here] = np.roll(RollPitchYaw(part).ToQuaternion().wxyz(), -1)
            else:
                q[here] = part
        return q


def _ground(plant: drake.MultibodyPlant) -> tree.RigidBody:
    """Return a body welded to the world: a constraint on the world's own body crashes Drake."""
    solid = tree.SpatialInertia.SolidSphereWithMass(1.0, 0.1)
    ground = plant.AddRigidBody("ground", solid)
    plant.WeldFrames(plant.world_frame(), ground.body_frame())
    return ground


def _pose(placement: tuple[np.ndarray, np.ndarray]) -> RigidTransform:
    return RigidTransform(RotationMatrix(placement[0]), placement[1])


def rotation(xyzw: np.ndarray) -> np.ndarray:
    """Return the matrix of a quaternion x y z w."""
    x, y, z, w = xyzw / np.linalg.norm(xyzw)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + 2.0 * w * K + 2.0 * K @ K
