"""A scene as every peer reads it: one JSON file, numpy and the standard library only.

``scene.json`` holds a tree of joints, each with the body that it carries, constraints of 3 or 6
rows between two joints, states that satisfy them, and the answers of `Reference` at these states::

    joints       name, parent, kind (free, ball, revolute, prismatic), axis, placement [R, p] on
                 the parent, first index and number of coordinates and velocities, mass, lever,
                 inertia (3, 3) about the centre of mass, armature
    constraints  name, rows, joint 1 and placement on it, joint 2 and placement on it; 0: world
    settings     mu, accuracy and iterations that condyn_pin chose for Pinocchio on this scene
    states       q, v, tau, a, da_dq, da_dv, da_dtau, tangent, a list of each; the columns of
                 tangent are motions (dq, dv) that stay on the constraints
    motion       duration [s], and q at its end, from the first state, without torques

``scene.xml`` beside it is the same in MJCF. Conventions are Pinocchio's: quaternions x y z w, the
velocity of a free joint in the axes of its body, linear first; columns of derivatives are tangent.
Joint i of the list is Pinocchio's joint i + 1.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

ACCELERATION, DERIVATIVES, MOTION = "acceleration", "derivatives", "motion"
GRAVITY = 9.81  # [m/s^2] the least that an error of a is relative to


@dataclass(frozen=True)
class Joint:
    """A joint with the body that it carries."""

    name: str
    parent: int
    kind: str
    axis: list[float]
    placement: tuple[np.ndarray, np.ndarray]  # R, p
    idx_q: int
    nq: int
    idx_v: int
    nv: int
    mass: float  # [kg]
    lever: np.ndarray  # [m]
    inertia: np.ndarray  # [kg m^2]
    armature: float  # [kg m^2] or [kg]


@dataclass(frozen=True)
class Constraint:
    """Two points (3 rows) or two frames (6 rows) that stay together."""

    name: str
    rows: int
    joint1: int
    placement1: tuple[np.ndarray, np.ndarray]
    joint2: int
    placement2: tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Exported:
    """A scene with states and answers."""

    name: str
    folder: Path
    gravity: np.ndarray
    joints: list[Joint]
    constraints: list[Constraint]
    motors: list[int]  # velocity indices
    settings: dict[str, Any]
    states: dict[str, np.ndarray]  # q, v, tau, a, da_dq, ..., each with one entry a state
    duration: float  # [s]
    end: np.ndarray  # q at the end of the motion

    @property
    def count(self) -> int:
        """Number of states."""
        return len(self.states["q"])

    @property
    def nv(self) -> int:
        """Size of a velocity."""
        return int(self.states["v"].shape[1])

    def state(self, i: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return q, v, tau of state i."""
        return self.states["q"][i], self.states["v"][i], self.states["tau"][i]

    def error(self, quantity: str, i: int, answer: Any) -> float:
        """Return how far an answer is from ours; infinite where it is not finite.

        Parameters
        ----------
        quantity : str
            acceleration
                |a - a_ref|_inf relative to the larger of |a_ref|_inf and gravity.
            derivatives
                of (da_dq, da_dv, columns of the motors of da_dtau): [da_dq da_dv] times `tangent`,
                and da_dtau; the worse of the two, each relative to its largest entry. Off the
                constraints they depend on how a gap is pulled back, and peers differ in that.
            motion
                |q - q_ref|_inf at the end, in the tangent space [rad, m].
        i : int
            The state.
        answer : array or tuple of array
        """
        if quantity == ACCELERATION:
            a = self.states["a"][i]
            error = float(np.abs(answer - a).max() / max(np.abs(a).max(), GRAVITY))
        elif quantity == DERIVATIVES:
            da_dq, da_dv, da_dtau = (self.states[key][i] for key in ("da_dq", "da_dv", "da_dtau"))
            T = self.states["tangent"][i]
            pairs = [
                (np.hstack(answer[:2]) @ T, np.hstack([da_dq, da_dv]) @ T),
                (answer[2], da_dtau[:, self.motors]),
            ]
            error = max(float(np.abs(x - y).max() / np.abs(y).max()) for x, y in pairs)
        else:
            error = float(np.abs(self.difference(self.end, np.asarray(answer))).max())
        return error if np.isfinite(error) else float("inf")

    def difference(self, q0: np.ndarray, q1: np.ndarray) -> np.ndarray:
        """Return q1 - q0, joint by joint; rotations by their nearest angle."""
        parts = []
        for joint in self.joints:
            x, y = (q[joint.idx_q : joint.idx_q + joint.nq] for q in (q0, q1))
            if joint.kind == "free":
                parts += [y[:3] - x[:3], _turn(x[3:], y[3:])]
            elif joint.kind == "ball":
                parts.append(_turn(x, y))
            elif joint.kind == "revolute":
                parts.append(np.remainder(y - x + np.pi, 2 * np.pi) - np.pi)
            else:
                parts.append(y - x)
        return np.concatenate(parts)


def _turn(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return 2 Im(conj(x) y) of quaternions x y z w: the rotation between them, where small."""
    vector = x[3] * y[:3] - y[3] * x[:3] - np.cross(x[:3], y[:3])
    return 2.0 * vector * np.sign(x @ y)


def load(folder: Path) -> Exported:
    """Return the scene of a folder that `export.export_scene` wrote."""
    saved = json.loads((folder / "scene.json").read_text(encoding="utf-8"))
    joints = [
        Joint(
            **{
                **joint,
                "placement": _placement(joint["placement"]),
                "lever": np.array(joint["lever"]),
                "inertia": np.array(joint["inertia"]),
            }
        )
        for joint in saved["joints"]
    ]
    constraints = [
        Constraint(
            **{
                **constraint,
                "placement1": _placement(constraint["placement1"]),
                "placement2": _placement(constraint["placement2"]),
            }
        )
        for constraint in saved["constraints"]
    ]
    return Exported(
        name=saved["name"],
        folder=folder,
        gravity=np.array(saved["gravity"]),
        joints=joints,
        constraints=constraints,
        motors=saved["motors"],
        settings=saved["settings"],
        states={key: np.array(value) for key, value in saved["states"].items()},
        duration=saved["motion"]["duration"],
        end=np.array(saved["motion"]["end"]),
    )


def _placement(pair: list[list[float]]) -> tuple[np.ndarray, np.ndarray]:
    R, p = pair
    return np.array(R), np.array(p)
