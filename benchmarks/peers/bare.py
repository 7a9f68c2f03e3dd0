"""Pinocchio with nothing around it, on any version: the reference, and a peer."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from peers.exported import ACCELERATION, DERIVATIVES, Exported
from peers.harness import REFERENCES, Candidate

PEER = "Pinocchio"
IS_4 = int(pin.__version__.split(".")[0]) >= 4
_AXES = {(1.0, 0.0, 0.0): "X", (0.0, 1.0, 0.0): "Y", (0.0, 0.0, 1.0): "Z"}


def model_of(scene: Exported) -> pin.Model:
    """Return the tree as a pinocchio.Model."""
    model = pin.Model()
    model.name = scene.name
    model.gravity = pin.Motion(np.array(scene.gravity), np.zeros(3))
    armature = np.zeros(scene.nv)
    for joint in scene.joints:
        i = model.addJoint(joint.parent, _joint(joint), pin.SE3(*joint.placement), joint.name)
        body = pin.Inertia(joint.mass, joint.lever, joint.inertia)
        model.appendBodyToJoint(i, body, pin.SE3.Identity())
        armature[joint.idx_v : joint.idx_v + joint.nv] = joint.armature
    model.armature = armature
    return model


def _joint(joint: Any) -> pin.JointModel:
    if joint.kind in ("free", "ball"):
        return pin.JointModelFreeFlyer() if joint.kind == "free" else pin.JointModelSpherical()
    axis = _AXES.get(tuple(joint.axis))
    short = {"revolute": "R", "prismatic": "P"}[joint.kind]
    if axis:
        return getattr(pin, f"JointModel{short}{axis}")()
    name = {"revolute": "Revolute", "prismatic": "Prismatic"}[joint.kind]
    return getattr(pin, f"JointModel{name}Unaligned")(np.array(joint.axis))


class Bare:
    """Pinocchio's objects for a scene."""

    def __init__(self, scene: Exported) -> None:
        self.model = model_of(scene)
        self.data = self.model.createData()
        self.models = pin.StdVec_RigidConstraintModel()
        self.datas = pin.StdVec_RigidConstraintData()
        for c in scene.constraints:
            kind = pin.ContactType.CONTACT_3D if c.rows == 3 else pin.ContactType.CONTACT_6D
            made = pin.RigidConstraintModel(
                kind,
                self.model,
                c.joint1,
                pin.SE3(*c.placement1),
                c.joint2,
                pin.SE3(*c.placement2),
                pin.ReferenceFrame.LOCAL,
            )
            self.models.append(made)
            self.datas.append(made.createData())
        both = (self.models, self.datas) if IS_4 else (self.models,)
        pin.initConstraintDynamics(self.model, self.data, *both)


def settings_of(settings: dict[str, Any]) -> pin.ProximalSettings:
    """Return Pinocchio's settings object."""
    return pin.ProximalSettings(
        settings["absolute_accuracy"],
        settings["relative_accuracy"],
        settings["mu"],
        settings["max_iterations"],
    )


def acceleration(scene: Exported, method: str, settings: dict[str, Any]) -> Candidate:
    """Return one call of constraintDynamics."""
    bare = Bare(scene)
    args = (bare.models, bare.datas, settings_of(settings))

    def call(i: int) -> np.ndarray:
        return pin.constraintDynamics(bare.model, bare.data, *scene.state(i), *args)

    return Candidate(ACCELERATION, method, call, lambda i: call(i).copy(), peer=PEER)


def derivatives(scene: Exported) -> Candidate:
    """Return constraintDynamics and computeConstraintDynamicsDerivatives."""
    bare = Bare(scene)
    args = (bare.models, bare.datas, settings_of(scene.settings))

    def call(i: int) -> None:
        pin.constraintDynamics(bare.model, bare.data, *scene.state(i), *args)
        pin.computeConstraintDynamicsDerivatives(bare.model, bare.data, *args)

    def answer(i: int) -> tuple[np.ndarray, ...]:
        call(i)
        d = bare.data
        return d.ddq_dq.copy(), d.ddq_dv.copy(), d.ddq_dtau[:, scene.motors]

    turning = scene.joints[0].kind == "revolute" and any(c.joint2 for c in scene.constraints)
    note = "its first column is wrong for a loop on a base that turns" if turning else ""
    return Candidate(DERIVATIVES, REFERENCES[DERIVATIVES], call, answer, note, PEER)


def references(scene: Exported) -> list[Candidate]:
    """Return what is timed in every environment."""
    hot = acceleration(scene, REFERENCES[ACCELERATION], scene.settings)
    return [hot, derivatives(scene)]
