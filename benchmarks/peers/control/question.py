"""The question that all controllers are asked, as a file: Talos stands, and is moved a little.

Two soles that neither slip nor tip nor pull, the centre of mass and the trunk where they are in the
posture half_sitting, and the joints near it; motors within their limits; no feedback on the feet.
Weights and gains are those of `Wish`; what is left to a controller is how it weighs forces.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Wish:
    """Weights and gains.

    Parameters
    ----------
    friction : float
        [1]
    com_kp, trunk_kp, posture_kp : float
        [1/s^2]; damping is critical, 2 sqrt(kp).
    com_weight, trunk_weight, posture_weight : float
        An infinite one is an equation.
    """

    friction: float = 0.5
    com_kp: float = 20.0
    trunk_kp: float = 100.0
    posture_kp: float = 100.0
    com_weight: float = 100.0
    trunk_weight: float = 50.0
    posture_weight: float = 0.1


@dataclass(frozen=True, eq=False)
class Question:
    """The robot, and the states in which it is asked.

    Attributes
    ----------
    urdf : str
        Path of a description without meshes.
    trunk : str
        Frame of the floating body.
    feet : list of str
        Frames of the soles.
    half_length, half_width : float
        Of the soles [m].
    home : (nq,) array
        The posture.
    com : (3,) array
        Centre of mass in it [m].
    armature, effort : (nv,) array
        [kg m^2], [N m]
    gravity : float
        [m/s^2]
    q, v : (k, nq), (k, nv) array
        Free-flyer first: position, quaternion x y z w; velocities in the body.
    wish : Wish
    title : str
        What is active, of a question that is asked once.
    """

    urdf: str
    trunk: str
    feet: list[str]
    half_length: float
    half_width: float
    home: Any
    com: Any
    armature: Any
    effort: Any
    q: Any
    v: Any
    wish: Wish
    title: str = ""

    def save(self, path: Path) -> Path:
        """Write it."""
        plain = {
            key: value.tolist() if isinstance(value, np.ndarray) else value
            for key, value in asdict(self).items()
        }
        path.write_text(json.dumps(plain), encoding="utf-8")
        return path

    @property
    def corners(self) -> np.ndarray:
        """The corners of a sole in its frame (3, 4) [m]."""
        x, y = self.half_length, self.half_width
        return np.array([[x, x, -x, -x], [y, -y, y, -y], [0.0, 0.0, 0.0, 0.0]])


def load(path: Path) -> Question:
    """Return what `Question.save` wrote."""
    saved = json.loads(path.read_text(encoding="utf-8"))
    arrays = ("home", "com", "armature", "effort", "q", "v")
    saved |= {key: np.array(saved[key]) for key in arrays}
    return Question(**{**saved, "wish": Wish(**saved["wish"])})
