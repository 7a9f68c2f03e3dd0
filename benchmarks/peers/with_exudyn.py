"""Exudyn: redundant coordinates, index 3, generalized alpha. It has no a of a state: motions only.

A closed planar chain has redundant rows, which exudyn refuses as a singular Jacobian; where all
joints of a scene turn about one direction, its loops are closed within the plane.
"""

from __future__ import annotations

import exudyn as exu
import numpy as np
from exudyn.utilities import (
    GenericJoint,
    MarkerBodyRigid,
    RigidBodyInertia,
    SphericalJoint,
)

from peers.exported import MOTION, Exported
from peers.harness import Candidate, main


def candidates(scene: Exported) -> list[Candidate]:
    """Return motions of planar mechanisms of hinges."""
    if any(joint.kind != "revolute" for joint in scene.joints):
        return []
    return [
        motion(scene, step, method) for method in ("index 3", "index 2") for step in (1e-3, 1e-4)
    ]


def motion(scene: Exported, step: float, method: str) -> Candidate:
    """Return SolveDynamic over the whole motion."""
    system = exu.SystemContainer()
    mbs = system.AddSystem()
    bodies = build(mbs, scene)
    settings = exu.SimulationSettings()
    time = settings.timeIntegration
    time.numberOfSteps, time.endTime = round(scene.duration / step), scene.duration
    time.verboseMode = 0
    time.generalizedAlpha.spectralRadius = 0.9
    time.generalizedAlpha.useIndex2Constraints = method == "index 2"
    time.generalizedAlpha.useNewmark = method == "index 2"
    time.newton.useModifiedNewton = True
    settings.solution.file.write = False

    def call(_: int) -> None:
        mbs.SolveDynamic(settings)

    def answer(_: int) -> np.ndarray:
        call(0)
        kind = exu.OutputVariableType.RotationMatrix
        rotations = [np.eye(3)] + [
            np.reshape(mbs.GetObjectOutputBody(body, kind), (3, 3)) for body in bodies
        ]
        return np.array(
            [
                angle((rotations[j.parent] @ j.placement[0]).T @ rotations[k + 1], j.axis)
                for k, j in enumerate(scene.joints)
            ]
        )

    name = f"generalized alpha, {method}, {1e3 * step:g} ms"
    return Candidate(
        MOTION, name, call, answer, "the loop is in C++; closed to rounding in index 3"
    )


def angle(R: np.ndarray, axis: list[float]) -> float:
    """Return the angle about a known axis."""
    s = np.array(axis)
    sine = s @ np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2
    cosine = (np.trace(R) - 1) / 2
    return float(np.arctan2(sine, cosine))


def build(mbs: exu.MainSystem, scene: Exported) -> list[int]:
    """Add bodies at the first state, hinges and loops; return the numbers of the bodies."""
    q, v, _ = scene.state(0)
    poses, twists = [(np.eye(3), np.zeros(3))], [(np.zeros(3), np.zeros(3))]
    numbers = [mbs.CreateGround()]
    for joint in scene.joints:
        (R0, p0), (omega0, v0) = poses[joint.parent], twists[joint.parent]
        R_on, p = R0 @ joint.placement[0], p0 + R0 @ joint.placement[1]
        axis = np.array(joint.axis)
        R = R_on @ _about(axis, q[joint.idx_q])
        omega = omega0 + R @ axis * v[joint.idx_v]
        poses.append((R, p))
        twists.append((omega, v0 + np.cross(omega0, p - p0)))
        body = mbs.CreateRigidBody(
            inertia=_inertia(joint),
            referencePosition=p,
            referenceRotationMatrix=R,
            initialVelocity=twists[-1][1],
            initialAngularVelocity=omega,
            gravity=scene.gravity,
        )
        _hinge(mbs, numbers[joint.parent], joint.placement, body, axis)
        numbers.append(body)
    normal = np.abs(scene.joints[0].axis)
    for c in scene.constraints:
        ends = zip((c.joint1, c.joint2), (c.placement1, c.placement2), strict=True)
        markers = [_marker(mbs, numbers[k], place[1], place[0]) for k, place in ends]
        mbs.AddObject(
            SphericalJoint(markerNumbers=markers, constrainedAxes=[int(n < 0.5) for n in normal])
        )
    mbs.Assemble()
    return numbers[1:]


def _inertia(joint: object) -> RigidBodyInertia:
    tensor, mass, lever = joint.inertia, joint.mass, joint.lever  # type: ignore[attr-defined]
    return RigidBodyInertia(mass=mass, inertiaTensor=tensor, com=lever, inertiaTensorAtCOM=True)


def _hinge(mbs: exu.MainSystem, parent: int, place: tuple, body: int, axis: np.ndarray) -> None:
    """Add a joint that is free about the third axis of both markers, which is the hinge's."""
    Z = _frame_with_z(axis)
    mbs.AddObject(
        GenericJoint(
            markerNumbers=[
                _marker(mbs, parent, place[1], place[0] @ Z),
                _marker(mbs, body, np.zeros(3), Z),
            ],
            constrainedAxes=[1, 1, 1, 1, 1, 0],
        )
    )


def _marker(mbs: exu.MainSystem, body: int, p: np.ndarray, R: np.ndarray) -> int:
    place = exu.HT(rotation=R, translation=p)
    return int(mbs.AddMarker(MarkerBodyRigid(bodyNumber=body, localHT=place)))


def _about(axis: np.ndarray, angle: float) -> np.ndarray:
    x, y, z = axis
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def _frame_with_z(axis: np.ndarray) -> np.ndarray:
    other = np.eye(3)[np.argmin(np.abs(axis))]
    x = np.cross(other, axis)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(axis, x), axis])


if __name__ == "__main__":
    main("exudyn", exu.__version__, candidates)
