"""Exudyn: redundant coordinates, implicit, index 3 or index 2, generalized alpha.

It has no a of a state: motions only. A closed planar chain of bodies in space has redundant rows,
which exudyn refuses as a singular Jacobian. Where all joints of a scene turn about one direction n,
its bodies are planar, with x = (e1, e2) p and the angle phi about n:

    phi = phi_parent + the angle of the joint's placement + q.
"""

from __future__ import annotations

import exudyn as exu
import numpy as np
from exudyn.utilities import (
    LoadMassProportional,
    MarkerBodyMass,
    MarkerBodyPosition,
    NodeRigidBody2D,
    ObjectGround,
    ObjectRigidBody2D,
    RevoluteJoint2D,
)

from peers.exported import MOTION, Exported
from peers.harness import Candidate, main

INDEX_3, INDEX_2 = "index 3", "index 2"


def candidates(scene: Exported) -> list[Candidate]:
    """Return motions of planar mechanisms of hinges."""
    planar = all(
        joint.kind == "revolute"
        and np.array_equal(joint.axis, scene.joints[0].axis)
        and np.allclose(joint.placement[0] @ joint.axis, joint.axis, atol=1e-12)
        for joint in scene.joints
    )
    if not planar:
        return []
    return [motion(scene, step, index) for index in (INDEX_3, INDEX_2) for step in (1e-3, 1e-4)]


def motion(scene: Exported, step: float, index: str) -> Candidate:
    """Return SolveDynamic over the whole motion."""
    mechanism = Mechanism(scene)
    settings = exu.SimulationSettings()
    time = settings.timeIntegration
    time.numberOfSteps, time.endTime = round(scene.duration / step), scene.duration
    time.verboseMode = 0
    time.generalizedAlpha.spectralRadius = 0.9
    time.generalizedAlpha.useIndex2Constraints = index == INDEX_2
    time.generalizedAlpha.useNewmark = index == INDEX_2
    time.newton.useModifiedNewton = True
    settings.solution.file.write = False

    def call(_: int) -> None:
        mechanism.mbs.SolveDynamic(settings)

    def answer(_: int) -> np.ndarray:
        call(0)
        return mechanism.angles()

    name = f"generalized alpha, {index}, {1e3 * step:g} ms"
    return Candidate(MOTION, name, call, answer, "the loop is in C++; redundant coordinates")


class Mechanism:
    """The planar bodies of a scene at its first state."""

    def __init__(self, scene: Exported) -> None:
        self.scene, self.system = scene, exu.SystemContainer()
        self.mbs = self.system.AddSystem()
        n = np.array(scene.joints[0].axis)
        e1 = np.cross(np.eye(3)[np.argmin(np.abs(n))], n)
        e1 /= np.linalg.norm(e1)
        self.plane = np.vstack([e1, np.cross(n, e1)])  # (2, 3)
        self.numbers = [self.mbs.AddObject(ObjectGround())]
        self.nodes: list[int] = []
        self.turned = [0.0]  # angle of each body [rad]
        self.centres = [np.zeros(2)]  # where each body has its centre of mass, in its own axes [m]
        origins, rates, slips = [np.zeros(2)], [0.0], [np.zeros(2)]
        q, v, _ = scene.state(0)
        for k, joint in enumerate(scene.joints):
            parent, (_, p) = joint.parent, joint.placement
            arm = _turn(self.turned[parent]) @ self.plane @ p
            self.turned.append(self.turned[parent] + self.bend(k) + q[joint.idx_q])
            self.centres.append(self.plane @ joint.lever)
            origins.append(origins[parent] + arm)
            rates.append(rates[parent] + v[joint.idx_v])
            slips.append(slips[parent] + rates[parent] * _quarter(arm))
            lever = _turn(self.turned[-1]) @ self.centres[-1]
            self._add_body(
                k, origins[-1] + lever, slips[-1] + rates[-1] * _quarter(lever), rates[-1]
            )
            self._hold(parent, p, k + 1, np.zeros(3))
        for c in scene.constraints:
            self._hold(c.joint1, c.placement1[1], c.joint2, c.placement2[1])
        self.mbs.Assemble()

    def bend(self, k: int) -> float:
        """Return the angle of the placement of joint k of the list."""
        R = self.plane @ self.scene.joints[k].placement[0] @ self.plane.T
        return float(np.arctan2(R[1, 0], R[0, 0]))

    def angles(self) -> np.ndarray:
        """Return q after a motion."""
        kind, moved = exu.OutputVariableType.Coordinates, [0.0]
        for node, start in zip(self.nodes, self.turned[1:], strict=True):
            moved.append(start + self.mbs.GetNodeOutput(node, kind)[2])
        joints = enumerate(self.scene.joints)
        return np.array([moved[k + 1] - moved[j.parent] - self.bend(k) for k, j in joints])

    def _add_body(self, k: int, centre: np.ndarray, slip: np.ndarray, rate: float) -> None:
        joint, n = self.scene.joints[k], np.array(self.scene.joints[0].axis)
        node = self.mbs.AddNode(
            NodeRigidBody2D(
                referenceCoordinates=[*centre, self.turned[k + 1]],
                initialVelocities=[*slip, rate],
            )
        )
        body = self.mbs.AddObject(
            ObjectRigidBody2D(mass=joint.mass, inertia=n @ joint.inertia @ n, nodeNumber=node)
        )
        mass = self.mbs.AddMarker(MarkerBodyMass(bodyNumber=body))
        gravity = [*(self.plane @ self.scene.gravity), 0.0]
        self.mbs.AddLoad(LoadMassProportional(markerNumber=mass, loadVector=gravity))
        self.nodes.append(node)
        self.numbers.append(body)

    def _hold(self, i: int, p: np.ndarray, j: int, r: np.ndarray) -> None:
        """Pin point p of body i to point r of body j; 0 is the ground."""
        markers = []
        for k, point in ((i, p), (j, r)):
            local = [*(self.plane @ point - self.centres[k]), 0.0]
            marker = MarkerBodyPosition(bodyNumber=self.numbers[k], localPosition=local)
            markers.append(self.mbs.AddMarker(marker))
        self.mbs.AddObject(RevoluteJoint2D(markerNumbers=markers))


def _turn(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def _quarter(x: np.ndarray) -> np.ndarray:
    return np.array([-x[1], x[0]])


if __name__ == "__main__":
    main("exudyn", exu.__version__, candidates)
